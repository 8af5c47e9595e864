"""The reconstruction of the thesis (4.1-4.2), the baseline of every comparison: right, not clever.

One GGX lobe fitted by (4.1); the weight f cos(theta_o) / pdf(wo | wi) of (4.3) interpolated linearly over
(theta_h, theta_d, |phi_d|); grids over half vectors per incidence, holes filled by Laplace's equation.
"""

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import QhullError

from gonio.brdf.models.ndf import GgxNdf
from gonio.brdf.tables.slices import SlicesBrdf, half_vectors, incidence_grid, pdf_grid
from gonio.geometry import Array, from_angles, half_vector, reflect, to_half_diff
from gonio.reconstruct.clean import usable
from gonio.reconstruct.errors import ReconstructionError
from gonio.reconstruct.fits.ggx import fit_cosine_weighted
from gonio.reconstruct.fits.laplace import fill_holes
from gonio.reconstruct.samples import Samples

INCIDENCES, ROWS, COLUMNS = 64, 65, 128


def fit(samples: Samples, *, anisotropic: bool, rng: np.random.Generator) -> SlicesBrdf:
    """Isotropic samples as the thesis's grids. Raises ReconstructionError."""
    if anisotropic:
        raise ReconstructionError("the thesis's reconstruction is for isotropic materials; take --model auto")
    s = usable(samples)
    alpha = fit_cosine_weighted(s).ndf.alpha_x
    interpolate = _interpolator(s, alpha)
    theta_i = incidence_grid(alpha, INCIDENCES)
    weight = np.stack([_slice(w, interpolate) for w in from_angles(theta_i, 0)])
    known = np.flatnonzero(np.isfinite(weight[:, 0, 0, 0]))
    if len(known) == 0:
        raise ReconstructionError(f"the {len(s)} samples enclose no incidence; measure more, and more widely")
    nearest = known[np.argmin(np.abs(np.arange(INCIDENCES)[:, None] - known), axis=1)]
    return SlicesBrdf(theta_i, alpha, pdf_grid(theta_i, alpha, ROWS, COLUMNS), np.maximum(weight[nearest], 0))


def _interpolator(s: Samples, alpha: float) -> LinearNDInterpolator:
    h = half_vector(s.wi, s.wo)
    pdf = GgxNdf(alpha, alpha).pdf(s.wi, h) / (4 * np.einsum("ni,ni->n", s.wi, h))
    points, first = np.unique(_coordinates(s.wi, s.wo), axis=0, return_index=True)
    try:
        return LinearNDInterpolator(points, (s.f * (s.wo[:, 2] / pdf)[:, None])[first])
    except QhullError:
        raise ReconstructionError(f"the {len(s)} samples lie on one spot or plane; measure more widely") from None


def _slice(wi: Array, interpolate: LinearNDInterpolator) -> Array:
    """The weights (ROWS, COLUMNS, C) of one incidence wi (3,), its holes filled."""
    half = half_vectors(ROWS, COLUMNS)[: ROWS // 2 + 1]  # the other half is its mirror image
    h = half.reshape(-1, 3)
    w = np.broadcast_to(wi, h.shape)
    value = interpolate(_coordinates(w, reflect(w, h)))
    value[h @ wi <= 0] = np.nan
    value = value.reshape(*half.shape[:2], -1)
    return fill_holes(np.concatenate([value, value[-2::-1]]))


def _coordinates(wi: Array, wo: Array) -> Array:
    theta_h, _, theta_d, phi_d = to_half_diff(wi, wo)
    return np.stack([theta_h, theta_d, np.abs(phi_d)], -1)
