"""Uncertainty sampling by a Gaussian process: of ln(f cos_o + e), squared-exponential over (sqrt theta_h, theta_d,
phi_d), each next direction where its predictive variance is largest (Seo et al. 2000;
Rasmussen & Williams 2006, 5.4).

Length scales, amplitude and noise by marginal likelihood, anew whenever the samples have doubled; between that the
variance does not hang on readings, so a block is chosen at once and toured at once. Cost grows as n^3.
"""

import numpy as np

from gonio.bench.peers.session import Session, visible
from gonio.geometry import Array, from_half_diff, to_half_diff
from gonio.mcmc.plans.unknown import PILOT, first_directions
from gonio.reconstruct import Samples

CANDIDATES = 6000
OF_LIKELIHOOD = 256  # samples that the marginal likelihood is asked of
START = np.log([0.3, 0.5, 1.0, 1.0, 0.05])  # three lengths, amplitude, noise


def look(session: Session, n: int, rng: np.random.Generator) -> None:
    wi, wo, _ = first_directions(False)
    keep = visible(session, wi, wo)
    first = min(PILOT, n)
    session(wi[keep][:first], wo[keep][:first])
    pool = candidates(session, rng)
    hyper = START
    while (left := n - session.measured) > 0:
        s = session.samples
        hyper = fitted(s, hyper, rng)
        chosen = most_uncertain(place(*pool), place(s.wi, s.wo), hyper, min(left, len(s)))
        session(pool[0][chosen], pool[1][chosen])


def candidates(session: Session, rng: np.random.Generator) -> tuple[Array, Array]:
    """CANDIDATES pairs even in the process's coordinates."""
    u = rng.random((6 * CANDIDATES, 3))
    wi, wo = from_half_diff(np.pi / 2 * u[:, 0] ** 2, 0 * u[:, 0], np.pi / 2 * u[:, 1], np.pi * u[:, 2])
    keep = np.flatnonzero(visible(session, wi, wo))[:CANDIDATES]
    return wi[keep], wo[keep]


def place(wi: Array, wo: Array) -> Array:
    """(N, 3): sqrt theta_h, theta_d, |phi_d| folded at a quarter turn (reciprocity)."""
    theta_h, _, theta_d, phi_d = to_half_diff(wi, wo)
    return np.stack([np.sqrt(theta_h), theta_d, np.pi / 2 - np.abs(np.abs(phi_d) - np.pi / 2)], 1)


def fitted(s: Samples, start: Array, rng: np.random.Generator) -> Array:
    """The logarithms of lengths, amplitude and noise that make the samples likeliest."""
    from scipy.optimize import minimize

    some = rng.permutation(len(s))[:OF_LIKELIHOOD]
    f_cos = np.maximum(s.f[some], 0).mean(1) * s.wo[some, 2]
    y = np.log(f_cos + 1e-3 * f_cos.mean())
    y -= y.mean()
    x = place(s.wi[some], s.wo[some])

    def loss(hyper: Array) -> float:
        k = kernel(x, x, hyper) + np.exp(2 * hyper[4]) * np.eye(len(x))
        try:
            low = np.linalg.cholesky(k)
        except np.linalg.LinAlgError:
            return 1e10
        z = np.linalg.solve(low, y)
        return float(0.5 * z @ z + np.log(np.diag(low)).sum())

    limits = [(-4, 2)] * 3 + [(-3, 3), (-5, 0)]
    return minimize(loss, start, method="L-BFGS-B", bounds=limits, options={"maxiter": 25}).x


def kernel(a: Array, b: Array, hyper: Array) -> Array:
    a, b = a / np.exp(hyper[:3]), b / np.exp(hyper[:3])
    squared = (a**2).sum(1)[:, None] + (b**2).sum(1)[None] - 2 * a @ b.T
    return np.exp(2 * hyper[3] - 0.5 * np.maximum(squared, 0))


def most_uncertain(pool: Array, known: Array, hyper: Array, count: int) -> Array:
    """Numbers of `count` of pool (M, 3), each of the largest variance given known (N, 3) and those before it."""
    noise = np.exp(2 * hyper[4])
    low = np.linalg.cholesky(kernel(known, known, hyper) + noise * np.eye(len(known)))
    rows = np.empty((len(known) + count, len(pool)))
    rows[: len(known)] = np.linalg.solve(low, kernel(known, pool, hyper))
    variance = np.exp(2 * hyper[3]) - (rows[: len(known)] ** 2).sum(0)
    chosen = []
    for k in range(len(known), len(rows)):  # one row of the Cholesky factor more for each pick
        best = int(np.argmax(variance))
        chosen.append(best)
        rest = kernel(pool[best : best + 1], pool, hyper)[0] - rows[:k, best] @ rows[:k]
        rows[k] = rest / np.sqrt(max(variance[best], 0) + noise)
        variance = variance - rows[k] ** 2
    return np.array(chosen)
