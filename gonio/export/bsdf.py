"""Any `Brdf` as an RGL `.bsdf`, which Mitsuba's `measured` and pbrt's "measured" read (Dupuy and Jakob 2018).

The table holds f cos(theta_o) 4 sigma(wi) / D(m) over a square that a warp stretches to where the lobe is. D here is
not a claim about the surface but the mean of f cos(theta_i) cos(theta_o) at each half vector. The `vndf` table, from
which loaders build the warp, is not D's visible normals either: it puts nodes where f changes, and `luminance` makes
up for it, so that samples still follow f cos(theta_o).

What 32 x 64^2 cannot hold: the last degrees before the horizon on a rough surface (f cos ends there with a kink), and
detail finer than 3 degrees of azimuth. More `incidences` and `resolution` do: the error falls about as 1 / resolution.
So the table is compared with the BRDF and made finer where it is needed.
"""

import os

import numpy as np

from gonio.brdf import Brdf, RglBrdf
from gonio.brdf.tables.tensor_file import write_tensor_file
from gonio.brdf.tables.warp import Interpolant, Warp
from gonio.evaluate import evaluate
from gonio.export import ExportError, checked
from gonio.export.about import About, lines
from gonio.export.profile import half_profile, half_width, projected_area, turns
from gonio.export.spectrum import WAVELENGTHS, upsample
from gonio.geometry import Array, from_angles, reflect

TABLE = 512  # nodes of theta_m in the ndf and vndf tables, half as many in anisotropic ones
AZIMUTHS = 65  # nodes of phi_m in them, odd so that the mirror image of a node is one
GRAZING = 1.5  # incidences at 90 degrees (1 - (1 - t)^GRAZING): closer together towards grazing
EDGE, EDGE_SHARE = np.radians(0.3), 0.3
POLE = 1e-3  # nodes at the pole step aside by this, to keep their azimuth: a measured table need not agree there
LAST = np.radians(89.0)
ENOUGH = 0.01  # energy error of a table against its BRDF above which it is made
FINER = (56, 112)  # instead
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def write_bsdf(
    brdf: Brdf,
    path: str | os.PathLike,
    *,
    anisotropic: bool | None = None,
    spectral: bool = False,
    incidences: int | None = None,
    resolution: int | None = None,
    description: str = "gonio",
    about: About | None = None,
) -> None:
    """Write `brdf` to `path`, whole or not at all; rgb (3 channels, or 1 that stands for all) unless `spectral`.

    about: what is known of the sample, added to the description, one line a key.

    anisotropic: a table over all azimuths of the light; None = where the BRDF is seen to change with them.
    Spectral files hold the channels at `brdf.wavelengths` (nm) where it has them, else a smooth upsampling of rgb.
    Defaults: 32 incidences of 64 x 64, and 56 of 112 x 112 where those are more than a percent off; anisotropic
    25 azimuths x 16 incidences of 32 x 32.
    Raises ExportError for a BRDF with NaN, negative values, or the wrong channels.
    """
    description = "\n".join([description, *lines(about or {})])
    brdf = Grey(brdf) if brdf.channels == 1 and not spectral else brdf
    made = fields(brdf, anisotropic, spectral, incidences, resolution, description)
    if incidences is None and resolution is None and len(made["phi_i"]) == 1 and _error(brdf, made) > ENOUGH:
        made = fields(brdf, False, spectral, *FINER, description)
    write_tensor_file(path, made)


class Grey:
    """A BRDF of one channel, in three that are alike."""

    def __init__(self, brdf: Brdf):
        self.brdf, self.channels = brdf, 3

    def eval(self, wi: Array, wo: Array) -> Array:
        return np.repeat(self.brdf.eval(wi, wo), 3, axis=-1)

    def sample(self, wi: Array, u: Array) -> tuple[Array, Array]:
        return self.brdf.sample(wi, u)

    def pdf(self, wi: Array, wo: Array) -> Array:
        return self.brdf.pdf(wi, wo)


def _error(brdf: Brdf, made: dict[str, Array]) -> float:
    """The referee's energy error of an rgb table against the BRDF it is made of; 0 of other tables."""
    return evaluate(RglBrdf(made), brdf, n=1500)["energy_mean"] if "rgb" in made else 0.0


def fields(
    brdf: Brdf,
    anisotropic: bool | None = None,
    spectral: bool = False,
    incidences: int | None = None,
    resolution: int | None = None,
    description: str = "gonio",
) -> dict[str, Array]:
    """The tensor file's fields; `RglBrdf(fields(...))` is the table as a `Brdf`."""
    known = getattr(brdf, "wavelengths", None)
    wavelengths = None if known is None else np.asarray(known, float)
    if brdf.channels != 3 and not (spectral and wavelengths is not None):
        wanted = "its wavelengths" if spectral else "3 for an rgb file"
        raise ExportError(f"the BRDF has {brdf.channels} channels, wanted {wanted}; nothing was written")
    anisotropic = turns(brdf) if anisotropic is None else anisotropic
    t = np.linspace(0, 1, incidences or (16 if anisotropic else 32))
    theta_i = LAST * (1 - (1 - t) ** GRAZING)
    phi_i = np.linspace(-np.pi, np.pi, 25) if anisotropic else np.zeros(1)
    n = resolution or (32 if anisotropic else 64)

    ndf = half_profile(brdf, TABLE // 2 if anisotropic else TABLE, AZIMUTHS if anisotropic else 2)
    sigma = projected_area(ndf, 64, 33 if anisotropic else 2)
    wi = from_angles(np.tile(theta_i, len(phi_i)), np.repeat(phi_i, len(theta_i)))
    vndf = _warp_density(ndf, wi, turn=not anisotropic)
    colour, luminance = _values(brdf, wi, vndf, ndf, sigma, n, mirror=not anisotropic)

    slices = (len(phi_i), len(theta_i))
    out = {
        "description": np.frombuffer(description.encode(), np.uint8),
        "phi_i": phi_i,
        "theta_i": theta_i,
        "sigma": sigma,
        "ndf": ndf,
        "vndf": vndf.reshape(*slices, *vndf.shape[1:]),
        "luminance": luminance.reshape(*slices, n, n),
        "jacobian": np.ones(1, np.uint8),
    }
    colour = np.moveaxis(colour.reshape(*slices, n, n, -1), -1, 2)
    if spectral and wavelengths is None:
        wavelengths, colour = WAVELENGTHS, np.einsum("ptcyx,wc->ptwyx", colour, upsample())
    if spectral:
        out |= {"wavelengths": wavelengths, "spectra": colour}
    else:
        out["rgb"] = colour
    return {key: v if v.dtype == np.uint8 else np.asarray(v, np.float32) for key, v in out.items()}


def _square(rows: int, columns: int) -> tuple[Array, Array]:
    """theta_m and phi_m (rows * columns,) of the nodes of a table over the square of half vectors."""
    y, x = np.meshgrid(np.linspace(0, 1, rows), np.linspace(0, 1, columns), indexing="ij")
    return np.pi / 2 * x.ravel() ** 2, np.pi * (2 * y.ravel() - 1)


def _warp_density(d: Array, wi: Array, turn: bool) -> Array:
    """(S, AZIMUTHS, columns), mean 1: where the nodes go. Azimuths are counted from wi's if `turn`.

    One part follows D, one is even in log(t0 + theta_m), t0 half the width of D: nodes per octave from the peak to
    the horizon; one is even in the logarithm of the distance from the horizon, where f cos(theta_o) ends with a kink.
    Half vectors that send wo below the horizon get none, so that the square's edge is the horizon.
    """
    columns = d.shape[1]
    theta, phi = _square(AZIMUTHS, columns)
    u = np.sqrt(theta * 2 / np.pi)
    profile = d.mean(0)[np.tile(np.arange(columns), AZIMUTHS)] if len(d) != AZIMUTHS else d.ravel()
    energy = profile * np.cos(theta) * np.sin(theta) * u
    octaves = u / (half_width(d) / 2 + theta)
    density = energy / energy.mean() + octaves / octaves.mean()
    out = []
    for w in wi:
        m = from_angles(theta, phi + (np.arctan2(w[1], w[0]) if turn else 0))
        up = (reflect(np.broadcast_to(w, m.shape), m)[:, 2] > 0).reshape(AZIMUTHS, columns)
        up[:, 1:] |= up[:, :-1].copy()  # one node beyond: the density falls to 0 within a cell
        rows = np.where(up, density.reshape(AZIMUTHS, columns), 0)
        to_horizon = np.max(np.where(up, theta.reshape(AZIMUTHS, columns), 0), axis=1)[:, None] - theta[:columns]
        edge = np.where(up, u[:columns] / (EDGE + np.maximum(to_horizon, 0)), 0)
        # every azimuth alike: by their share of the density the few half vectors of the forward ones would go short
        out.append(rows / rows.sum(1, keepdims=True) + EDGE_SHARE * edge / edge.sum(1, keepdims=True))
    table = np.array(out)
    return table / table.mean((1, 2), keepdims=True)


def _values(brdf: Brdf, wi: Array, vndf: Array, ndf: Array, sigma: Array, n: int, mirror: bool) -> tuple[Array, Array]:
    """(S, n, n, C) stored values and (S, n, n) luminance: how much light arrives from each place of the square."""
    warp = Warp(vndf.astype(np.float32))
    rows = (n + 1) // 2 if mirror else n  # of an isotropic surface the other half is the mirror image
    v, u = np.meshgrid(np.linspace(0, 1, n)[:rows], np.linspace(0, 1, n), indexing="ij")
    u, v = np.tile(u.ravel(), len(wi)), np.tile(v.ravel(), len(wi))
    k = np.repeat(np.arange(len(wi)), rows * n)
    x, y, _ = warp.sample(u, v, [(k, np.ones(len(k)))])
    x = np.maximum(x, POLE)
    density = warp.eval(x, y, [(k, np.ones(len(k)))])
    a = wi[k]
    phi_i = np.arctan2(a[:, 1], a[:, 0]) if mirror else 0
    m = from_angles(np.pi / 2 * x * x, np.pi * (2 * y - 1) + phi_i)
    wo = reflect(a, m)
    cos_im = np.einsum("ni,ni->n", a, m)
    f_cos = np.zeros((len(k), brdf.channels))
    above = (wo[:, 2] > 0) & (cos_im > 0)
    f_cos[above] = checked(brdf, a[above], wo[above]) * wo[above, 2:]

    d, s = (Interpolant(np.asarray(table, np.float32)[None, :, :, None]) for table in (ndf, sigma))
    at = [(np.zeros(len(k), np.int64), np.ones(len(k)))]
    theta_i = np.arctan2(np.hypot(a[:, 0], a[:, 1]), a[:, 2])
    azimuth = (np.arctan2(a[:, 1], a[:, 0]) + np.pi) / (2 * np.pi)
    scale = 4 * s.eval(np.sqrt(theta_i * 2 / np.pi), azimuth, at)[:, 0] / d.eval(x, y, at)[:, 0]
    area = 2 * np.pi**2 * x * np.sin(np.pi / 2 * x * x) * 4 * np.maximum(cos_im, 0)
    weights = LUMINANCE if brdf.channels == 3 else np.full(brdf.channels, 1 / brdf.channels)
    light = (f_cos @ weights) * area / np.maximum(density, 1e-300)

    colour = (f_cos * scale[:, None]).reshape(len(wi), rows, n, -1)
    luminance = light.reshape(len(wi), rows, n)
    if mirror:
        colour, luminance = (np.concatenate([half, half[:, ::-1][:, n % 2 :]], axis=1) for half in (colour, luminance))
    mean = luminance.mean((1, 2), keepdims=True)
    return colour, np.where(mean > 0, luminance / np.where(mean > 0, mean, 1) + 1e-3, 1)


def as_brdf(brdf: Brdf, **options) -> RglBrdf:
    """The exported table as a `Brdf`, without a file; options as of `fields`."""
    return RglBrdf(fields(brdf, **options))
