"""Any `Brdf` as the text of ASTM E1392-96: rows theta_i, phi_i, theta_s, phi_s (radians) and the channels.

A lattice of angles, for readers (libbsdf) make one of the rows: incidences, thetas that crowd around each mirror
direction as the lobe is wide, azimuths that crowd around pi. Of an anisotropic BRDF at several azimuths of the light.
"""

import os

import numpy as np

from gonio.atomic import write_text
from gonio.brdf import Brdf
from gonio.export import checked
from gonio.export.exchange.lattice import Lattice, say_loss
from gonio.export.profile import half_profile, half_width, turns
from gonio.geometry import Array, from_angles

INCIDENCE = np.radians(np.arange(0, 86, 10.0))
THETA = np.radians(np.arange(0, 89, 3.0))
PHI = np.radians(np.arange(0, 181, 7.5))
CROWD = np.array([0.2, 0.4, 0.7, 1.2, 2.5])  # of the lobe's width, on either side of the mirror direction
LIGHTS = np.radians(np.arange(0, 360, 30.0))  # azimuths, of an anisotropic one


def write_astm(brdf: Brdf, path: str | os.PathLike, channels: tuple[str, ...] | None = None) -> None:
    """Whole or not at all. Warns (ExportWarning) of what it cannot hold; raises ExportError (NaN, negative values)."""
    width = 2 * half_width(half_profile(brdf, 512, 2))
    beside = np.concatenate([-CROWD[::-1], [0], CROWD]) * width
    theta = _merged(THETA, (INCIDENCE[:, None] + beside).ravel(), 0, np.radians(89))
    half = _merged(PHI, np.pi - np.concatenate([CROWD, 4 * CROWD[1:]]) * width, 0, np.pi)
    phi = np.concatenate([half, 2 * np.pi - half[-2:0:-1]])
    lights = LIGHTS if turns(brdf) else np.zeros(1)
    axes = INCIDENCE, lights, theta, phi
    i, p, t, a = (x.ravel() for x in np.meshgrid(*axes, indexing="ij"))
    f = checked(brdf, from_angles(i, p), from_angles(t, a + p))
    names = channels or (("R", "G", "B") if brdf.channels == 3 else tuple(f"c{k}" for k in range(brdf.channels)))
    # between incidences every reader has a way of its own: what is told here is what the rows themselves hold
    table = f.reshape(len(INCIDENCE), len(lights), len(theta), len(phi), -1)[:, 0]
    table = np.concatenate([table, table[:, :, :1]], 2)
    lattice = Lattice(_coordinates, (INCIDENCE, theta, np.append(phi, 2 * np.pi)), table)
    say_loss(lattice, brdf, "this lattice of ASTM E1392", INCIDENCE)
    head = ["ASTM E1392-96", "CREATED_BY gonio", f"NUM_POINTS {len(f)}"]
    head.append(f"VARS theta_i,phi_i,theta_s,phi_s,{','.join(n.replace(',', ' ').replace(' ', '_') for n in names)}")
    angles = np.stack([i, p, t, (a + p) % (2 * np.pi)], 1)
    rows = [",".join([*(f"{x:.8g}" for x in w), *(f"{v:.7g}" for v in values)]) for w, values in zip(angles, f)]
    write_text(path, "\n".join([*head, *rows]) + "\n")


def _merged(even: Array, extra: Array, low: float, high: float) -> Array:
    """Both, ascending, those within a tenth of a degree of each other once."""
    both = np.unique(np.concatenate([even, extra[(extra >= low) & (extra <= high)]]))
    keep = np.concatenate([[True], np.diff(both) > np.radians(0.1)])
    return both[keep]


def _coordinates(wi: Array, wo: Array) -> tuple[Array, Array, Array]:
    theta_i, theta_o = (np.arctan2(np.hypot(w[:, 0], w[:, 1]), w[:, 2]) for w in (wi, wo))
    phi = np.arctan2(wo[:, 1], wo[:, 0]) - np.arctan2(wi[:, 1], wi[:, 0])
    return theta_i, theta_o, phi % (2 * np.pi)
