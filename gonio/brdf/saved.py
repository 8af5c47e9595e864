"""How BRDFs are saved: an .npz without pickles, with the `kind` of the BRDF, a format version, and its arrays."""

import os

import numpy as np

from gonio.atomic import replacing
from gonio.geometry import Array

FORMAT_VERSION = 1


def write_saved(path: str | os.PathLike, kind: str, arrays: dict[str, Array]) -> None:
    """Write the file; it appears whole or not at all. Raises OSError, ValueError (an array of objects)."""
    plain = {key: np.asarray(value) for key, value in arrays.items()}
    with replacing(path) as stream:
        np.savez(stream, allow_pickle=False, kind=np.array(kind), format_version=np.array(FORMAT_VERSION), **plain)
