"""Any isotropic `Brdf` as the thesis's own grids: incidences by sigma(theta_i), pdf and weights over half vectors.

The .npz opens with `gonio.load_brdf`; its arrays are those of `gonio.brdf.tables.slices.SlicesBrdf`.
"""

import os

import numpy as np

from gonio.brdf import Brdf
from gonio.brdf.models.ndf import GgxNdf
from gonio.brdf.saved import write_saved
from gonio.brdf.tables.slices import SlicesBrdf, half_vectors, incidence_grid, pdf_grid
from gonio.export import checked
from gonio.export.about import About, lines
from gonio.export.profile import half_profile, half_width
from gonio.geometry import from_angles, reflect

INCIDENCES, ROWS, COLUMNS = 64, 65, 128


def write_grid(brdf: Brdf, path: str | os.PathLike, about: About | None = None) -> None:
    """Write the grids of `brdf` to `path` (.npz), whole or not at all. Raises ExportError (NaN, negative values).

    about: what is known of the sample, kept as the array of text `about`, one line a key.
    """
    grid = to_grid(brdf)
    write_saved(path, grid.kind, grid.to_arrays() | {"about": np.array(lines(about or {}), str)})


def to_grid(brdf: Brdf) -> SlicesBrdf:
    """The grids as a `Brdf`: bilinear between incidences, as the thesis's renderer plug-in does."""
    # a GGX lobe falls to half at tan^2(theta_h) = (sqrt 2 - 1) alpha^2
    alpha = float(np.clip(np.tan(half_width(half_profile(brdf, 512, 2))) / np.sqrt(np.sqrt(2) - 1), 1e-3, 1))
    theta_i = incidence_grid(alpha, INCIDENCES)
    ndf = GgxNdf(alpha, alpha)
    h = half_vectors(ROWS, COLUMNS)[: ROWS // 2 + 1].reshape(-1, 3)  # the other half is its mirror image
    weight = []
    for w in from_angles(theta_i, 0):
        wi = np.broadcast_to(w, h.shape)
        wo = reflect(wi, h)
        up = (wo[:, 2] > 0) & (h @ w > 0)
        value = np.zeros((len(h), brdf.channels))
        pdf = ndf.pdf(wi[up], h[up]) / (4 * h[up] @ w)
        value[up] = checked(brdf, wi[up], wo[up]) * (wo[up, 2] / pdf)[:, None]
        half = value.reshape(-1, COLUMNS, brdf.channels)
        weight.append(np.concatenate([half, half[-2::-1]]))
    return SlicesBrdf(theta_i, alpha, pdf_grid(theta_i, alpha, ROWS, COLUMNS), np.array(weight))
