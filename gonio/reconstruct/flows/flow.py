"""The second stage of the thesis (4.11)–(4.15): a flow's density times a constant, fitted to f cos(theta_o).

    f_k(wi, wo) cos(theta_o) = c q(wi, wo) share_k exp(colour_k(wi, wo))

q is one flow for all channels, fitted to S = the channels' sum, each over its mean, by the relative error (4.11); c is
the closed-form optimum for fixed weights, taken anew only at the best state (the thesis's (4.15), for the relative
error). Samples are drawn in proportion to S, so that the mean relative error is the share of energy misplaced; those
where S is low count like any other. What is left to colour_k is smooth: splines through the log of the channels' share
in S. The thesis fitted every channel by itself, and lost green and blue where no sample was bright in red.

`flow` works in the half-vector cube about the incidence (theta_i leads), `flow_hd` in the thesis's half/difference one.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from gonio.flow import shipped
from gonio.flow.cubes import make_cube
from gonio.flow.density import FlowDensity
from gonio.flow.flow import Flow, FlowError, Shape
from gonio.geometry import Array
from gonio.reconstruct.clean import clean
from gonio.reconstruct.errors import ReconstructionError
from gonio.reconstruct.samples import Samples
from gonio.reconstruct.splines.auto import Problem, peak_width
from gonio.reconstruct.splines.frame import Frame
from gonio.reconstruct.splines.grain import Grain
from gonio.reconstruct.splines.isotropic import Isotropic
from gonio.reconstruct.splines.patches import Patches
from gonio.reconstruct.splines.residual import LogRatio
from gonio.reconstruct.tables.lookup import Lookup
from gonio.reconstruct.tables.sampled import Sampled

LOG_LARGEST = 20.0
HELD_OUT = 8
STEPS = 1500
FIRST_FIT = 600  # samples by which a code is found


class FlowBrdf(Sampled):
    """The BRDF of `fit`: a flow's density, its constant, and the channels' shares. Sampled by the flow itself."""

    kind = "flow"

    def __init__(
        self, density: FlowDensity, log_c: float, ratio: LogRatio, share: Array, frame: Frame,
        t0: float, colour: Array,
    ):  # fmt: skip
        self.density, self.log_c, self.channels = density, log_c, len(share)
        self.ratio, self.share, self.frame, self.t0 = ratio, share, frame, t0
        self.chart = frame.chart(t0)
        self.colour = Lookup(colour, self.chart.periodic, self.chart.refine)

    def _above(self, wi: Array, wo: Array) -> Array:
        a = self.frame.angles(wi, wo)
        s = np.exp(np.minimum(self.log_c + self.density.log_prob(wi, wo), LOG_LARGEST))
        return self.ratio.inverse(self.colour(self.chart(a)), s[:, None] * self.share) / a.cos_o[:, None]

    @property
    def sampler(self):
        """The flow given wi; a table made when first asked for, where the flow does not know p(wo | wi)."""
        return FlowSampler(self.density) if self.density.cube.leading else super().sampler

    def to_arrays(self) -> dict[str, Array]:
        own = {
            "log_c": np.array(self.log_c),
            "floor": self.ratio.floor,
            "share": self.share,
            "t0": np.array(self.t0),
            "colour": self.colour.values,
        }
        return own | self.frame.to_arrays() | self.density.to_arrays()

    @classmethod
    def from_arrays(cls, d: dict[str, Array]) -> "FlowBrdf":
        frame: Frame = Grain(*(float(v) for v in d["grain"])) if "grain" in d else Isotropic()
        ratio, t0 = LogRatio(d["floor"]), float(d["t0"])
        return cls(FlowDensity.from_arrays(d), float(d["log_c"]), ratio, d["share"], frame, t0, d["colour"])


class FlowSampler:
    """p(wo | wi) of a flow whose leading coordinates are wi's, mixed with a tenth of cosine-weighted directions."""

    COSINE = 0.1

    def __init__(self, density: FlowDensity):
        self.density = density

    def sample(self, wi: Array, u: Array) -> tuple[Array, Array]:
        from gonio.brdf.models.lambert import cosine_hemisphere

        wi, u = np.atleast_2d(wi), np.atleast_2d(u)
        even = u[:, 0] < self.COSINE
        v = np.where(even, u[:, 0] / self.COSINE, (u[:, 0] - self.COSINE) / (1 - self.COSINE))
        u = np.stack([np.minimum(v, 1 - 1e-16), u[:, 1]], 1)
        wo = cosine_hemisphere(u)
        if not even.all():
            wo[~even] = self.density.sample_conditional(wi[~even], u[~even])[0]
        return wo, self.pdf(wi, wo)

    def pdf(self, wi: Array, wo: Array) -> Array:
        wi, wo = np.atleast_2d(wi), np.atleast_2d(wo)
        out = np.zeros(len(wi))
        up = (wi[:, 2] > 0) & (wo[:, 2] > 0)
        flow = np.exp(self.density.conditional(wi[up], wo[up]))
        out[up] = self.COSINE * wo[up, 2] / np.pi + (1 - self.COSINE) * flow
        return out


def fit(samples: Samples, *, anisotropic: bool, rng: np.random.Generator, coordinates: str = "half") -> FlowBrdf:
    """Raises ReconstructionError for samples too few or too poor."""
    s = clean(samples)
    s = s[~s.saturated]
    frame: Frame = Grain.of(s.wi, s.wo, np.maximum(s.f, 0)) if anisotropic else Isotropic()
    p = Problem.of(s, frame, rng)
    g = np.maximum(p.g, 0)
    share = np.maximum(g.mean(0), 1e-4 * g.mean(0).max())
    total = (g / share).mean(1)
    density, log_c = fit_density(s.wi, s.wo, total, floor_of(total, p.sigma / share), coordinates, anisotropic, rng)
    t0 = peak_width(p)
    stretch, chart = frame.stretch(t0), frame.chart(t0)
    # the splines see the measured sum, not the flow's: what they hold is colour, whatever the flow is worth
    b = total[:, None] * share
    patches = Patches(stretch(p.angles), p.ratio.forward(g, b), p.ratio.variance(g, p.sigma, b))
    nodes, above = chart.nodes(chart.coarse)
    colour = np.zeros((len(above), len(share)))
    need = above > -0.15
    colour[need] = patches(stretch(nodes.at(need)))
    return FlowBrdf(density, log_c, p.ratio, share, frame, t0, colour.reshape(*chart.coarse, -1))


def floor_of(total: Array, sigma: Array) -> float:
    """What `total` (N,) is noise below: the sigma (N, C) of its dark samples, or a thousandth of its median."""
    return float(max(1e-3 * np.median(total), np.quantile(sigma.mean(1), 0.1), 1e-9 * total.max()))


def fit_density(
    wi: Array, wo: Array, total: Array, floor: float, coordinates: str, anisotropic: bool, rng: np.random.Generator
) -> tuple[FlowDensity, float]:
    """A flow and log c such that c q(wi, wo) is `total` (N,), S cos(theta_o), in mean relative error (4.11).

    floor is added to `total`: what lies below it is noise.
    """
    try:
        from gonio.flow.train import match
    except ImportError as e:
        raise ReconstructionError(f"a flow is trained by torch ({e}); pip install 'gonio[flow]', or use auto") from None
    cube = make_cube(coordinates, 0.1, anisotropic)
    x = cube.from_directions(wi, wo)
    # to the cube: c q_x = S cos(theta_o) |d(wi, wo)/dx|
    log_g = np.log(total + floor) + cube.log_jacobian(x, wi, wo)
    start = None
    if coordinates == "half" and not anisotropic:
        try:
            start = _by_code(*shipped.conditional(), x, log_g, rng)
        except FlowError:
            pass  # the weights that ship are missing or spoilt: begin with nothing
    if start is None:
        shape = Shape.of(cube, bins=24, hidden=64, encoding="one_blob")
        start = Flow.fresh(shape, rng)
    held = np.arange(len(x)) % HELD_OUT == 0
    flow, log_c = match(start, x, log_g, held, steps=STEPS, rng=rng)
    density = FlowDensity(flow, cube)
    # the constant for densities of directions instead of the cube's
    offset = density.log_prob(wi[:1], wo[:1]) + cube.log_jacobian(x[:1], wi[:1], wo[:1]) - flow.log_prob(x[:1])
    return density, log_c - float(offset[0])


def _by_code(flow: Flow, codes: Any, x: Array, log_g: Array, rng: np.random.Generator) -> Flow:
    """The conditional flow at the code whose log density runs along log_g the closest, up to a constant."""
    from scipy.optimize import least_squares

    few = rng.permutation(len(x))[:FIRST_FIT]
    x, log_g = x[few], log_g[few]

    def residual(unit: Array) -> Array:
        r = flow.at(codes.code(unit)).log_prob(x) - log_g
        return np.concatenate([r - np.median(r), 0.3 * unit])

    misfit: Callable[[Array], float] = lambda unit: float(np.abs(residual(unit)[: len(x)]).mean())
    start = min((codes.inside(codes.unit(c)) for c in codes.table), key=misfit)
    best = least_squares(residual, start, loss="soft_l1", diff_step=3e-3, max_nfev=20)
    return flow.at(codes.code(codes.inside(best.x)))
