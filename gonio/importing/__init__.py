"""Other laboratories' files -> readings -> a run folder that all later commands work on. One reader a module.

A reader takes paths and gives `Readings`; `formats` finds which; `doubt` asks physics whether the file was understood;
`run` makes the folder.
"""

from dataclasses import dataclass

from gonio.geometry import Array


class CannotImport(ValueError):
    """A file that cannot be imported: which, where in it, what to do. One line."""

    exit_code = 2


QUANTITIES = {
    "f": "f, the BRDF in 1/sr",
    "f_cos": "f cos(theta_o) in 1/sr (DSF, cosine-corrected BRDF)",
    "factor": "reflectance factor, pi f",
    "counts": "counts in proportion to f cos(theta_o)",
}


@dataclass(frozen=True)
class Readings:
    """N rows as a file has them, nothing left out yet.

    wi, wo    (N, 3) unit vectors to the light and to the detector; NaN where the file has no direction
    value     (N, C) of `quantity`, a key of QUANTITIES; None where the file does not say which it is
    sigma     (N, C) standard deviations of `value`, None where the file has none
    channels  (C,) names; X, Y, Z are CIE tristimulus values
    format    a key of `gonio.importing.formats.FORMATS`
    mapping   what was taken as what, for the record
    said      lines about what was guessed or left out
    doubts    lines about what contradicts how the file was taken
    symmetry  isotropic or anisotropic where the file says it
    """

    wi: Array
    wo: Array
    value: Array
    sigma: Array | None
    channels: tuple[str, ...]
    quantity: str | None
    format: str
    mapping: dict[str, str]
    said: tuple[str, ...] = ()
    symmetry: str | None = None
    doubts: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.value)
