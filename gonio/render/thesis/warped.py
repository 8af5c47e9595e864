"""6.5: a grid whose nodes lie where the fitted pdf is high, as the thesis tried it: what the pdf misses, it loses."""

import numpy as np
from matplotlib.figure import Figure

from gonio.brdf import Brdf
from gonio.brdf.tables.slices import incidence_grid, pdf_grid
from gonio.brdf.tables.warp import Interpolant, ParameterGrid, Warp
from gonio.geometry import Array, from_angles, half_vector, reflect, to_angles
from gonio.render.shade import psnr, to_srgb
from gonio.render.thesis.subject import Subject

INCIDENCES, ROWS, COLUMNS = 32, 33, 64


class WarpedSlices:
    """f cos(theta_o) of `brdf` at nodes drawn from the visible normals of a GGX lobe; read between them."""

    def __init__(self, brdf: Brdf, alpha: float):
        self.channels = brdf.channels
        theta_i = incidence_grid(alpha, INCIDENCES)
        self._grid, self._warp = ParameterGrid(theta_i), Warp(pdf_grid(theta_i, alpha, 65, 128))
        v, u = (a.ravel() for a in np.meshgrid(np.linspace(0, 1, ROWS), np.linspace(0, 1, COLUMNS), indexing="ij"))
        slices = []
        for k, w in enumerate(from_angles(theta_i, 0)):
            x, y, _ = self._warp.sample(u, v, [(np.full(len(u), k), np.ones(len(u)))])
            h = from_angles(np.pi / 2 * x * x, 2 * np.pi * y)
            wi = np.broadcast_to(w, h.shape)
            wo = reflect(wi, h)
            slices.append((brdf.eval(wi, wo) * np.maximum(wo[:, 2:], 0)).reshape(ROWS, COLUMNS, -1))
        self._values = Interpolant(np.array(slices))

    def eval(self, wi: Array, wo: Array) -> Array:
        out = np.zeros((len(wi), self.channels))
        up = (wi[:, 2] > 0) & (wo[:, 2] > 1e-6)
        theta_h, phi_h = to_angles(half_vector(wi[up], wo[up]))
        theta_i, phi_i = to_angles(wi[up])
        x, y = np.sqrt(theta_h * 2 / np.pi), np.mod((phi_h - phi_i) / (2 * np.pi), 1)
        g = np.zeros((len(x), self.channels))
        for k, weight in self._grid.corners(theta_i):
            u, v, _ = self._warp.invert(x, y, [(k, np.ones(len(k)))])
            g += weight[:, None] * self._values.eval(u, v, [(k, np.ones(len(k)))])
        out[up] = g / wo[up, 2:]
        return out


def non_uniform(s: Subject) -> Figure:
    """Truth, and the truth through such a grid of the thesis's fitted lobe."""
    image = s.image(WarpedSlices(s.known, s.thesis.alpha))  # type: ignore[arg-type]  # only eval is asked for
    figure = Figure(figsize=(5.6, 3.2), layout="constrained")
    titles = ("truth", f"on nodes drawn by the fit, α {s.thesis.alpha:.2g}: {psnr(image, s.truth_image):.1f} dB")
    for axis, picture, title in zip(figure.subplots(1, 2), (s.truth_image, image), titles):
        axis.imshow(to_srgb(picture))
        axis.set_title(title, fontsize=9)
        axis.set_axis_off()
    return figure
