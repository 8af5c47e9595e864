"""How BRDFs are saved: an .npz without pickles, with the `kind` of the BRDF, a format version, and its arrays."""

import os
import struct
import tokenize
import zipfile
import zlib

import numpy as np
from numpy.lib import format as npy

from gonio.atomic import replacing
from gonio.geometry import Array

FORMAT_VERSION = 1
MOST_BYTES = 2**31  # of all arrays of a file: far above any of ours


def read_arrays(path: str | os.PathLike) -> dict[str, Array]:
    """Every array of an .npz without pickles. How large they are is looked at first: a few bytes may claim terabytes.

    Raises ValueError, one line; FileNotFoundError.
    """
    try:
        if os.path.exists(path) and not os.path.isfile(path):
            raise ValueError("not a file")
        with zipfile.ZipFile(path) as held:
            if (total := sum(member.file_size for member in held.infolist())) > MOST_BYTES:
                raise ValueError(f"its arrays claim {total} bytes, {MOST_BYTES} is the most that is read")
            for member in held.infolist():
                _as_long_as_it_says(held, member)
        with np.load(path, allow_pickle=False) as file:
            return {key: file[key] for key in file.files}
    except FileNotFoundError:
        raise
    except (
        OSError, EOFError, KeyError, TypeError, SyntaxError, NotImplementedError, RuntimeError, OverflowError,
        zipfile.BadZipFile, zipfile.LargeZipFile, zlib.error, struct.error, tokenize.TokenError,
    ) as e:  # fmt: skip
        raise ValueError(" ".join(str(e).split())[:200] or type(e).__name__) from None


def _as_long_as_it_says(held: zipfile.ZipFile, member: zipfile.ZipInfo) -> None:
    """Raises ValueError for an array whose shape and bytes contradict each other."""
    with held.open(member) as stream:
        version = npy.read_magic(stream)
        if version not in ((1, 0), (2, 0)):
            raise ValueError(f"{member.filename}: of an unknown version {version}")
        read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
        shape, _, dtype = read(stream)
        count = 1
        for n in shape:
            count *= n
        if not dtype.hasobject and stream.tell() + count * dtype.itemsize != member.file_size:
            raise ValueError(f"{member.filename}: {member.file_size} bytes for an array of shape {shape}")


def write_saved(path: str | os.PathLike, kind: str, arrays: dict[str, Array]) -> None:
    """Write the file; it appears whole or not at all. Raises OSError, ValueError (an array of objects)."""
    plain = {key: np.asarray(value) for key, value in arrays.items()}
    with replacing(path) as stream:
        np.savez(stream, allow_pickle=False, kind=np.array(kind), format_version=np.array(FORMAT_VERSION), **plain)
