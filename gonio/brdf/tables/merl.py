"""The tables of the MERL database (Matusik et al. 2003), `.binary`: 90 x 90 x 180 bins of (theta_h, theta_d, phi_d).

Header of three int32 (90, 90, 180), then float64 for red, green, blue; theta_h bins are even in sqrt(theta_h), phi_d
covers [0, pi) by reciprocity. A value times 1/1500, 1.15/1500, 1.66/1500 is f in 1/sr. Negative = not measured.
"""

import os
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from gonio.atomic import replacing
from gonio.brdf.base import BrdfFileError
from gonio.brdf.models.half_sampler import HalfSampler
from gonio.geometry import Array, directions, to_half_diff

SHAPE = (90, 90, 180)
SCALE = np.array([1.0, 1.15, 1.66]) / 1500
RELAXED = 20
SIZE = 12 + 3 * 8 * SHAPE[0] * SHAPE[1] * SHAPE[2]


class MerlBrdf:
    """A MERL table, nearest bin. table (3, 90, 90, 180) holds f in 1/sr; negative = not measured.

    What was not measured has its neighbours' value, channel by channel; `invalid_entries` counts it, (3,).
    """

    channels = 3

    def __init__(self, table: Array):
        if table.shape != (3, *SHAPE):
            raise ValueError(f"a MERL table has the shape (3, 90, 90, 180), not {table.shape}")
        self.invalid_entries = np.count_nonzero(table < 0, axis=(1, 2, 3))
        if self.invalid_entries.any():
            table = np.stack([filled(channel) for channel in table])
        self._table = np.moveaxis(np.asarray(table, float), 0, -1).reshape(-1, 3)
        edges = np.pi / 2 * (np.arange(91) / 90) ** 2
        # incidences of 0..70 degrees, where theta_d is about theta_i
        f = np.maximum(table[:, :, 5:70], 0).mean((0, 2, 3))
        self._sampler = HalfSampler(edges, f * np.cos(edges[:-1]) * np.diff(-np.cos(edges)))

    @classmethod
    def from_file(cls, source: str | os.PathLike | BinaryIO, name: str | None = None) -> "MerlBrdf":
        """Read a table from a path or an open binary file. Raises BrdfFileError."""
        name = name or str(source)
        if isinstance(source, str | os.PathLike):
            try:
                with open(source, "rb") as stream:
                    return cls(read_merl(stream, name))
            except OSError as e:
                raise BrdfFileError(f"{name}: cannot be read ({e.strerror or e})") from None
        return cls(read_merl(source, name))

    def eval(self, wi: Array, wo: Array) -> Array:
        wi, wo = directions(wi), directions(wo)
        out = np.zeros((len(wi), 3))
        above = (wi[:, 2] > 0) & (wo[:, 2] > 0)
        theta_h, _, theta_d, phi_d = to_half_diff(wi[above], wo[above])
        out[above] = np.maximum(self._table.take(bin_index(theta_h, theta_d, phi_d), axis=0), 0)
        return out

    def sample(self, wi: Array, u: Array) -> tuple[Array, Array]:
        return self._sampler.sample(wi, u)

    def pdf(self, wi: Array, wo: Array) -> Array:
        return self._sampler.pdf(wi, wo)


def filled(channel: Array) -> Array:
    """One channel (90, 90, 180), its negative entries by their neighbours: first the nearest, then relaxed.

    phi_d wraps. Raises ValueError for a channel without a single valid entry.
    """
    from scipy.ndimage import distance_transform_edt

    hole = channel < 0
    if hole.all():
        raise ValueError("a channel of the table has no valid entry")
    if not hole.any():
        return channel
    half = SHAPE[2] // 2
    wide = np.concatenate([channel[:, :, half:], channel, channel[:, :, :half]], 2)  # so that phi_d has no edge
    nearest = distance_transform_edt(wide < 0, return_distances=False, return_indices=True)
    out = wide[tuple(nearest)][:, :, half : half + SHAPE[2]]
    h, d, p = np.nonzero(hole)
    around = [
        (np.maximum(h - 1, 0), d, p), (np.minimum(h + 1, SHAPE[0] - 1), d, p),
        (h, np.maximum(d - 1, 0), p), (h, np.minimum(d + 1, SHAPE[1] - 1), p),
        (h, d, (p - 1) % SHAPE[2]), (h, d, (p + 1) % SHAPE[2]),
    ]  # fmt: skip
    for _ in range(RELAXED):
        out[h, d, p] = sum(out[each] for each in around) / 6
    return out


def bin_index(theta_h: Array, theta_d: Array, phi_d: Array) -> NDArray[np.int64]:
    """Flat number of the bin of angles in radians, (N,)."""
    i = np.clip((np.sqrt(np.clip(theta_h / (np.pi / 2), 0, 1)) * 90).astype(int), 0, 89)
    j = np.clip((theta_d / (np.pi / 2) * 90).astype(int), 0, 89)
    k = np.clip(((phi_d % np.pi) / np.pi * 180).astype(int), 0, 179)
    return (i * 90 + j) * 180 + k


def read_merl(stream: BinaryIO, name: str) -> Array:
    """f (3, 90, 90, 180) in 1/sr. The size is checked before anything is read. Raises BrdfFileError."""
    size = stream.seek(0, os.SEEK_END)
    stream.seek(0)
    dims = np.frombuffer(stream.read(12).ljust(12, b"\0"), "<i4")
    if size < 12 or tuple(dims) != SHAPE:
        raise BrdfFileError(f"{name}: byte 0: {tuple(dims.tolist())} where a MERL file has (90, 90, 180)")
    if size != SIZE:
        raise BrdfFileError(f"{name}: has {size} bytes, a MERL file has {SIZE}; truncated or corrupt, get it again")
    table = np.frombuffer(stream.read(SIZE - 12), "<f8").reshape(3, *SHAPE)
    if not np.isfinite(table).all():
        byte = 12 + 8 * int(np.flatnonzero(~np.isfinite(table.ravel()))[0])
        raise BrdfFileError(f"{name}: byte {byte}: not a finite number; corrupt, get it again")
    if np.abs(table).max() > 1e30:
        raise BrdfFileError(f"{name}: holds values above 1e30; corrupt, get it again")
    if (table < 0).all((1, 2, 3)).any():
        raise BrdfFileError(f"{name}: a channel without a single valid entry; corrupt, get it again")
    return table * SCALE[:, None, None, None]


def write_merl_table(path: str | os.PathLike, table: Array) -> None:
    """Write f (3, 90, 90, 180) in 1/sr; the file appears whole or not at all."""
    with replacing(path) as stream:
        stream.write(np.array(SHAPE, "<i4").tobytes())
        stream.write((np.asarray(table, float) / SCALE[:, None, None, None]).astype("<f8").tobytes())
