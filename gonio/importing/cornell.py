"""Rows of numbers without a header, as Cornell's Light Measurement Laboratory gives its scattered readings.

`theta_i phi_i theta_r phi_r value ...`; spherical angles of the two directions in radians (degrees are seen by their
size), the mirror direction at phi_i + pi; 31 values are 400 to 700 nm in steps of 10 (graphics.cornell.edu,
"Reflectance Data": 31 or 61 wavelengths; azimuths from -pi to pi).
"""

from pathlib import Path

from gonio.importing import CannotImport, Readings
from gonio.importing.delimited import Choices, TextTable, read_table
from gonio.importing.roles import SPHERICAL, Column, Mapping
from gonio.importing.text import MOST_CHANNELS, channel_names, read_lines

STEPS_NM = {31: 10, 61: 5}


def read(path: Path, choices: Choices) -> Readings:
    """Raises CannotImport."""
    table = TextTable(read_lines(path), str(path))
    values = table.width - 4
    if not 1 <= values <= MOST_CHANNELS:
        raise CannotImport(
            f"{path}: {table.width} numbers in the first row; theta_i phi_i theta_r phi_r and values expected"
        )
    step = STEPS_NM.get(values)
    channels = tuple(f"{400 + step * k}nm" for k in range(values)) if step else channel_names(values)
    angles = [Column(f"column {k + 1}", role, "", "", "place") for k, role in enumerate(SPHERICAL)]
    columns = [*angles, *(Column(f"column {k + 5}", "f", c, "", "place") for k, c in enumerate(channels))]
    return read_table(table, Mapping(tuple(columns), "f"), choices, "cornell")
