"""Readings that stand at one pair of polar angles and differ: an azimuth that was overlooked?"""

import numpy as np

from gonio.geometry import Array
from gonio.importing import CannotImport

SHARE = 0.1  # of the readings
SIGMAS, RELATIVE = 3.0, 0.05  # from the mean of their pair, the second where no sigma is known


def overlooked(theta_i: Array, theta_o: Array, value: Array, sigma: Array, unused: list[str]) -> str | None:
    """A line where many readings, value and sigma (N, C), differ at one pair of angles and columns are unused."""
    if not unused:
        return None
    known = np.isfinite(theta_i) & np.isfinite(theta_o) & np.isfinite(value).all(1)
    if not known.any():
        return None
    value, sigma = value[known], sigma[known]
    places = np.round(np.stack([theta_i, theta_o], 1)[known], 6)
    _, group, size = np.unique(places, axis=0, return_inverse=True, return_counts=True)
    group = group.ravel()
    mean = np.stack([np.bincount(group, v) / size for v in value.T], 1)[group]
    allowed = np.where(np.isfinite(sigma) & (sigma > 0), SIGMAS * sigma, RELATIVE * np.abs(mean))
    differ = (np.abs(value - mean) > allowed).any(1)
    if differ.sum() <= SHARE * len(value):
        return None
    return (
        f"several values at one pair of angles: is one of the unused columns ({', '.join(unused)[:200]}) the azimuth? "
        f"--column NAME=phi"
    )


def varying(names: list[str], table) -> list[str]:
    """Those of the columns of a table that hold numbers, and not one alone."""
    found = []
    for k, name in enumerate(table.names):
        if name not in names:
            continue
        try:
            column = table.columns([k])
        except CannotImport:
            continue
        if np.nanmax(column, initial=-np.inf) > np.nanmin(column, initial=np.inf):
            found.append(name)
    return found
