"""What a coupling's network is shown of the coordinates that it does not move.

`plain`: 2x - 1 of each; `one_blob`: besides, a Gaussian bump over 8 cells (Müller 2019); `harmonics`: real spherical
harmonics to degree 2 of the direction that the first two coordinates make (elevation and azimuth), if there are two.
Periodic coordinates are shown as cos 2πx and sin 2πx, so that 0 and 1 are one place.
"""

from typing import Any

import numpy as np

from gonio.geometry import Array

BLOBS = 8
CENTRES = (np.arange(BLOBS) + 0.5) / BLOBS


def width(kind: str, periodic: tuple[bool, ...]) -> int:
    """How many numbers `features` gives per point."""
    plain = sum(2 if p else 1 for p in periodic)
    if kind == "one_blob":
        return plain + BLOBS * len(periodic)
    if kind == "harmonics" and len(periodic) >= 2:
        return plain + 8
    return plain


def features(kind: str, x: Array, periodic: tuple[bool, ...]) -> Array:
    """(N, width + 1) float32 from x (N, len(periodic)) in [0, 1]; the last is 1, for the biases."""
    return np.concatenate([*columns(kind, x, periodic, np, CENTRES), np.ones((len(x), 1))], 1).astype(np.float32)


def columns(kind: str, x: Any, periodic: tuple[bool, ...], xp: Any, centres: Any) -> list[Any]:
    """The columns of `features`, with xp = numpy or torch and CENTRES as its array: one formula for both."""
    out = []
    for k, wraps in enumerate(periodic):
        column = x[:, k : k + 1]
        if wraps:
            out += [xp.cos(2 * np.pi * column), xp.sin(2 * np.pi * column)]
        else:
            out.append(2 * column - 1)
        if kind == "one_blob":
            away = column - centres
            if wraps:
                away = away - xp.round(away)
            out.append(xp.exp(-0.5 * (BLOBS * away) ** 2))
    if kind == "harmonics" and len(periodic) >= 2:
        out.append(_harmonics(0.5 * np.pi * x[:, 0], (2 if periodic[1] else 1) * np.pi * x[:, 1], xp))
    return out


def _harmonics(elevation: Any, azimuth: Any, xp: Any) -> Any:
    """Degrees 1 and 2, unnormalised, (N, 8)."""
    s, z = xp.sin(elevation), xp.cos(elevation)
    x, y = s * xp.cos(azimuth), s * xp.sin(azimuth)
    return xp.stack([x, y, z, x * y, y * z, x * z, 1.5 * z * z - 0.5, x * x - y * y], -1)
