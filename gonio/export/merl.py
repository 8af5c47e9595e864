"""Any isotropic, reciprocal `Brdf` as a MERL `.binary`: each bin holds the mean over the bin."""

import os

import numpy as np

from gonio.brdf import Brdf
from gonio.brdf.tables.merl import SHAPE, write_merl_table
from gonio.export import ExportError, checked
from gonio.geometry import Array, above_horizon, from_half_diff

POINTS = 2  # per bin, along theta_h where the peak is; each with the light and the detector exchanged too
SLAB = 5  # theta_h bins at a time, to bound the memory


def write_merl(brdf: Brdf, path: str | os.PathLike) -> None:
    """Write `brdf` (3 channels) to `path`, whole or not at all; a bin that is all below the horizon holds -1.

    Raises ExportError for a BRDF with NaN, negative values or other than 3 channels.
    """
    write_merl_table(path, merl_table(brdf))


def merl_table(brdf: Brdf) -> Array:
    """f (3, 90, 90, 180) in 1/sr, the mean over each bin's points above the horizon and over phi_d, phi_d + pi."""
    if brdf.channels != 3:
        raise ExportError(f"the BRDF has {brdf.channels} channels, a MERL file has 3; nothing was written")
    inside = (np.arange(POINTS) + 0.5) / POINTS
    theta_d = (np.arange(SHAPE[1]) + 0.5) / SHAPE[1] * np.pi / 2
    phi_d = (np.arange(SHAPE[2]) + 0.5) / SHAPE[2] * np.pi
    slabs = []
    for first in range(0, SHAPE[0], SLAB):
        root = (np.arange(first, first + SLAB)[:, None] + inside).ravel() / SHAPE[0]
        th, td, pd = (a.ravel() for a in np.meshgrid(np.pi / 2 * root**2, theta_d, phi_d, indexing="ij"))
        wi, wo = from_half_diff(th, np.zeros_like(th), td, pd)
        seen = above_horizon(wi, wo)
        f = np.zeros((len(th), 3))
        f[seen] = 0.5 * (checked(brdf, wi[seen], wo[seen]) + checked(brdf, wo[seen], wi[seen]))
        bins = (SLAB, POINTS, SHAPE[1], SHAPE[2])
        count = seen.reshape(bins).sum(1)[..., None]
        total = f.reshape(*bins, 3).sum(1)
        slabs.append(np.where(count > 0, total / np.maximum(count, 1), -1))
    return np.moveaxis(np.concatenate(slabs), -1, 0)
