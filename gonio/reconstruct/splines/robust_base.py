"""A first guess at g = f cos(theta_o) that holds over many decades: a dictionary of lobes, weights >= 0, log loss.

    g = (a + b s) cos(theta_o) + c + d s + sum_k D_k(theta_h) / (4 cos theta_d) (p_k + q_k s) (1 or m)

with D_k = GGX of fixed roughness alpha_k, s = (1 - cos theta_d)^5 (Schlick 1994), m = 2 cos_o / (cos_i + cos_o), which
fades towards the horizon of wo; measured tables want both, those that fade and those that do not. Linear in the
weights, so non-negative least squares finds the optimum without a start to choose; the log loss by reweighting.
"""

from dataclasses import dataclass, fields

import numpy as np

from gonio.geometry import Array
from gonio.reconstruct.splines.frame import PairAngles

ALPHA = np.geomspace(0.002, 0.8, 12)
MOST = 3000
SUPPORT = 8
NOISY = 0.5  # of the median of g: noise above that hides the logarithm
STEPS = 8192
_STEP = np.arcsinh(np.pi / 2 / ALPHA[0]) / STEPS


@dataclass(frozen=True)
class Angles:
    """Of N pairs: theta_h, theta_d, |phi_d| and the cosines of wi, wo with the normal, (N,) each."""

    theta_h: Array
    theta_d: Array
    phi_d: Array
    cos_i: Array
    cos_o: Array

    @classmethod
    def of(cls, wi: Array, wo: Array) -> "Angles":
        s, t = wi + wo, wi - wo
        (sx, sy, sz), (tx, ty, tz) = s.T, t.T
        across = np.hypot(sx, sy)
        length = np.hypot(across, sz)
        flat = across > 0
        cp, sp = np.where(flat, sx, 1) / np.where(flat, across, 1), np.where(flat, sy, 0) / np.where(flat, across, 1)
        x = (sz * (cp * tx + sp * ty) - across * tz) / np.maximum(length, 1e-300)
        y = cp * ty - sp * tx
        theta_d = np.arctan2(np.hypot(np.hypot(tx, ty), tz), length)
        phi_d = np.arctan2(np.abs(y), x)
        return cls(np.arctan2(across, sz), theta_d, phi_d, np.maximum(wi[:, 2], 1e-6), np.maximum(wo[:, 2], 1e-6))

    def at(self, index) -> "Angles":
        """Those at `index`."""
        return Angles(*(getattr(self, k.name)[index] for k in fields(self)))


class RobustBase:
    """g (N, C) of `Angles`; weights (4 + 4 len(ALPHA), C), in the order of `dictionary`."""

    weight = 0.0  # of a prior in it (gonio.reconstruct.prior)

    def __init__(self, weights: Array):
        self.weights = np.asarray(weights, float)
        # the lobes' sums at fine steps of asinh(theta_h / ALPHA[0]): 3e-6 off, and a tenth of the time
        theta_h = ALPHA[0] * np.sinh(np.arange(STEPS + 1) * _STEP)
        k = len(ALPHA)
        parts = [lobes(theta_h) @ self.weights[4 + i * k : 4 + (i + 1) * k] for i in range(4)]
        self._radial = np.concatenate(parts, 1)

    @property
    def channels(self) -> int:
        return self.weights.shape[1]

    def to_arrays(self) -> dict[str, Array]:
        return {"weights": self.weights}

    def __call__(self, a: PairAngles) -> Array:
        """(N, C)."""
        x = np.arcsinh(a.theta_h / ALPHA[0]) / _STEP
        low = np.minimum(x.astype(int), STEPS - 1)
        part = (x - low)[:, None]
        radial = self._radial.take(low, 0)
        radial += part * (self._radial.take(low + 1, 0) - radial)
        cos_d = np.maximum(np.cos(a.theta_d), 0.02)
        schlick = ((1 - cos_d) ** 5)[:, None]
        fading = (2 * a.cos_o / (a.cos_i + a.cos_o))[:, None]
        c = self.weights.shape[1]
        plain = radial[:, :c] + schlick * radial[:, c : 2 * c]
        plain += fading * (radial[:, 2 * c : 3 * c] + schlick * radial[:, 3 * c :])
        w = self.weights
        return plain / (4 * cos_d[:, None]) + a.cos_o[:, None] * (w[0] + schlick * w[1]) + w[2] + schlick * w[3]

    @classmethod
    def fit(
        cls, a: PairAngles, g: Array, floor: Array, rng: np.random.Generator, sigma: Array | None = None
    ) -> "RobustBase":
        """floor (C,): what is added inside the logarithm, about the smallest g that matters; sigma (N, C) of g."""
        pick = rng.choice(len(g), MOST, replace=False) if len(g) > MOST else np.arange(len(g))
        columns = dictionary(a.at(pick)) * supported(a)
        weights = log_nnls(columns, g[pick], floor)
        if sigma is not None:
            for c in np.flatnonzero(np.median(sigma, 0) > NOISY * np.median(np.abs(g), 0)):
                weights[:, c] = plain_nnls(columns, g[pick, c], sigma[pick, c])
        return cls(weights)


def log_nnls(columns: Array, g: Array, floor: Array) -> Array:
    """Weights >= 0, (K, C), of columns (N, K) under which ln(model + floor) is nearest to ln(g + floor), g (N, C)."""
    from scipy.optimize import nnls

    weights = []
    for c in range(g.shape[1]):
        # in units of the brightest, so that no power of a tiny f overflows
        scale = float(g[:, c].max() + floor[c])
        e = floor[c] / scale
        y = np.maximum(g[:, c], 0) / scale + e
        energy = y**0.1  # a little more say to what carries energy: the least error of the final result
        w = energy / (y + 0.1 * np.median(y))
        x = np.zeros(columns.shape[1])
        for _ in range(7):
            x, _ = nnls(columns * w[:, None], (y - e) * w, maxiter=5000)
            model = columns @ x + e
            log, gap = np.log(model / y), model - y
            # the weight under which a square is the square of the logarithm, large ones held back (Huber)
            exact = np.where(np.abs(log) > 1e-4, log / np.where(gap == 0, 1, gap), 1 / y)
            w = np.sqrt(w * exact * energy / (1 + (log / 0.5) ** 2) ** 0.25)
        weights.append(scale * x)
    return np.stack(weights, 1)


def plain_nnls(columns: Array, g: Array, sigma: Array) -> Array:
    """Weights >= 0 (K,) by least squares of g itself (N,), of noise sigma: where noise hides the logarithm.

    Half of the values lie below 0 then, and only with their sign does the mean come out right.
    """
    from scipy.optimize import nnls

    unit = np.maximum(columns.max(0), 1e-300)
    model = np.zeros(len(g))
    for _ in range(3):
        w = 1 / np.hypot(sigma, 0.1 * model)
        # a little of a ridge: what data do not tell apart is shared, not given to one
        ridge = np.diag(np.full(len(unit), 1.0))
        x, _ = nnls(np.concatenate([columns / unit * w[:, None], ridge]), np.concatenate([g * w, np.zeros(len(unit))]))
        model = columns / unit @ x
    return x / unit


def dictionary(a: PairAngles) -> Array:
    """The columns of the module's docstring, (N, 4 + 4 K)."""
    cos_d = np.maximum(np.cos(a.theta_d), 0.02)
    schlick = (1 - cos_d) ** 5
    fading = 2 * a.cos_o / (a.cos_i + a.cos_o)
    one = np.ones_like(schlick)
    d = lobes(a.theta_h) / (4 * cos_d[:, None])
    s, m = schlick[:, None], fading[:, None]
    return np.concatenate([np.stack([a.cos_o, schlick * a.cos_o, one, schlick], 1), d, d * s, d * m, d * m * s], 1)


def supported(a: PairAngles) -> Array:
    """1 for the columns that samples can tell from nothing, 0 for peaks narrower than any sample saw, (4 + 4 K,)."""
    inside = a.theta_h[:, None] < ALPHA
    grazing = inside & (np.cos(a.theta_d) < 0.4)[:, None]
    plain, schlick = ((n.sum(0) >= SUPPORT).astype(float) for n in (inside, grazing))
    return np.concatenate([np.ones(4), plain, schlick, plain, schlick])


def lobes(theta_h: Array) -> Array:
    """D (N, K) of GGX for each ALPHA."""
    s, c = np.sin(theta_h)[:, None], np.cos(theta_h)[:, None]
    return 1 / (np.pi * ALPHA**2 * ((s / ALPHA) ** 2 + c**2) ** 2)
