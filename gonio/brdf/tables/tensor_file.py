"""The container of RGL's `.bsdf` files: named n-dimensional arrays (Dupuy and Jakob 2018). Knows nothing of BRDFs.

Layout, little-endian: `tensor_file\\0`, version 1.0 (2 bytes), number of fields (u32), then per field the length of its
name (u16), the name, its rank (u16), a type code (u8), the byte where its data start (u64) and its shape (u64 each).
"""

import math
import os
import struct
from pathlib import Path
from typing import BinaryIO

import numpy as np

from gonio.atomic import replacing
from gonio.brdf.base import BrdfFileError

MAGIC = b"tensor_file\0"
TYPES = {1: "u1", 2: "i1", 3: "u2", 4: "i2", 5: "u4", 6: "i4", 7: "u8", 8: "i8", 9: "f2", 10: "f4", 11: "f8"}
CODES = {np.dtype(t): code for code, t in TYPES.items()}
MAX_RANK = 16


def read_tensor_file(source: str | os.PathLike | BinaryIO, name: str | None = None) -> dict[str, np.ndarray]:
    """All fields of a tensor file, in the types they are stored in.

    source is a path or an open binary file; `name` is what errors call it. Nothing is allocated before its size is
    checked against the file's, and all fields together never exceed it. Raises BrdfFileError naming the byte.
    """
    if isinstance(source, str | os.PathLike):
        name = name or str(source)
        try:
            with open(source, "rb") as stream:
                return _read(stream, name)
        except OSError as e:
            raise BrdfFileError(f"{name}: cannot be read ({e.strerror or e})") from None
    return _read(source, name or "tensor file")


def write_tensor_file(path: str | os.PathLike, fields: dict[str, np.ndarray]) -> None:
    """Write `fields` to `path`, in order, data aligned to 8 bytes; the file appears whole or not at all."""
    encoded = [(key.encode(), np.ascontiguousarray(value)) for key, value in fields.items()]
    offset = 18 + sum(2 + len(key) + 2 + 1 + 8 + 8 * v.ndim for key, v in encoded)
    header, at = [MAGIC, bytes([1, 0]), struct.pack("<I", len(encoded))], []
    for key, v in encoded:
        offset += -offset % 8
        at.append(offset)
        header.append(struct.pack("<H", len(key)) + key)
        header.append(struct.pack(f"<HBQ{v.ndim}Q", v.ndim, CODES[v.dtype], offset, *v.shape))
        offset += v.nbytes
    with replacing(Path(path)) as stream:
        stream.write(b"".join(header))
        for start, (_, v) in zip(at, encoded):
            stream.write(b"\0" * (start - stream.tell()))
            stream.write(v.astype(v.dtype.newbyteorder("<"), copy=False).tobytes())


def _read(stream: BinaryIO, name: str) -> dict[str, np.ndarray]:
    size = stream.seek(0, os.SEEK_END)
    stream.seek(0)
    position = 0

    def take(n: int, what: str) -> bytes:
        nonlocal position
        data = stream.read(n)
        if len(data) < n:
            raise BrdfFileError(f"{name}: ends at byte {size} within {what}; the file is truncated, get it again")
        position += n
        return data

    if take(12, "the magic word") != MAGIC:
        raise BrdfFileError(f"{name}: byte 0: not an RGL tensor file (the magic word 'tensor_file' is missing)")
    version = take(2, "the version")
    if version[0] != 1:
        raise BrdfFileError(f"{name}: byte 12: version {version[0]}.{version[1]} of the format, only 1.x can be read")
    (count,) = struct.unpack("<I", take(4, "the number of fields"))
    if count * 13 > size:
        raise BrdfFileError(f"{name}: byte 14: {count} fields do not fit in {size} bytes; the file is corrupt")
    directory: dict[str, tuple[np.dtype, int, tuple[int, ...]]] = {}
    total = 0
    for k in range(count):
        start = position
        (length,) = struct.unpack("<H", take(2, f"field {k + 1}"))
        try:
            key = take(length, f"the name of field {k + 1}").decode()
        except UnicodeDecodeError:
            raise BrdfFileError(f"{name}: byte {start + 2}: the name of field {k + 1} is not text") from None
        rank, code, offset = struct.unpack("<HBQ", take(11, f"field '{key}'"))
        if rank > MAX_RANK or code not in TYPES:
            raise BrdfFileError(f"{name}: byte {start}: field {key!r} has rank {rank} and type {code}; corrupt")
        shape = struct.unpack(f"<{rank}Q", take(8 * rank, f"the shape of {key!r}"))
        dtype = np.dtype("<" + TYPES[code])
        nbytes = math.prod(shape) * dtype.itemsize
        total += nbytes
        if key in directory:
            raise BrdfFileError(f"{name}: byte {start}: field {key!r} appears twice")
        if offset + nbytes > size or total > size:
            raise BrdfFileError(
                f"{name}: byte {start}: field {key!r} claims {nbytes} bytes at {offset}, but the file has {size}; "
                "truncated or corrupt, get it again"
            )
        directory[key] = (dtype, offset, shape)
    fields = {}
    for key, (dtype, offset, shape) in directory.items():
        stream.seek(offset)
        data = stream.read(math.prod(shape) * dtype.itemsize)
        try:
            fields[key] = np.frombuffer(data, dtype).reshape(shape)
        except ValueError:  # a shape such as (0, 2**63), empty and yet too large
            raise BrdfFileError(f"{name}: field {key!r} cannot have the shape {shape}; corrupt") from None
    return fields
