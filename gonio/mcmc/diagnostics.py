"""Has a chain converged, and how much is it worth? numpy and scipy only; the same figures as ArviZ.

All take draws x (chains, steps). Vehtari, Gelman, Simpson, Carpenter, Buerkner, "Rank-normalization, folding, and
localization: an improved R-hat", Bayesian Analysis 16(2), 2021; Pareto k: Vehtari et al., "Pareto smoothed importance
sampling", JMLR 25, 2024 (its fit by Zhang & Stephens 2009).
"""

import numpy as np

from gonio.geometry import Array


def split(x: Array) -> Array:
    """Each chain as its two halves (an odd middle draw is dropped)."""
    x = np.atleast_2d(x)
    half = x.shape[1] // 2
    return np.concatenate([x[:, :half], x[:, x.shape[1] - half :]])


def rank_normal(x: Array) -> Array:
    """Normal scores of the ranks over all chains together (ties share their mean rank)."""
    from scipy.special import ndtri
    from scipy.stats import rankdata

    rank = rankdata(x, method="average").reshape(x.shape)
    return ndtri((rank - 0.375) / (x.size + 0.25))


def rhat(x: Array) -> float:
    """Rank-normalised split R-hat, the larger of bulk and folded; NaN for chains that never moved or are too short."""
    x = split(x)
    if x.shape[1] < 2 or not np.isfinite(x).all() or np.ptp(x) == 0:
        return float("nan")
    folded = np.abs(x - np.median(x))
    return max(_rhat(rank_normal(x)), _rhat(rank_normal(folded)))


def ess_bulk(x: Array) -> float:
    """Effective samples for the middle of the distribution."""
    return _ess(rank_normal(split(x)))


def ess_tail(x: Array) -> float:
    """Effective samples for the 5 % and 95 % quantiles, the smaller."""
    x = np.atleast_2d(x)
    return min(_ess(split((x <= np.quantile(x, p)).astype(float))) for p in (0.05, 0.95))


def ess_mean(x: Array) -> float:
    """Effective samples for the mean of x as it stands (no ranks): what an integral's error hangs on."""
    return _ess(split(x))


def mcse_mean(x: Array) -> float:
    """Monte Carlo standard error of the mean of all draws."""
    x = np.atleast_2d(x)
    return float(x.std(ddof=1) / np.sqrt(ess_mean(x)))


def autocorrelation_time(x: Array) -> tuple[float, bool]:
    """(tau, trusted): steps per effective sample; trusted where every chain is longer than 50 tau."""
    x = np.atleast_2d(x)
    tau = x.size / ess_mean(x)
    return float(tau), bool(x.shape[1] > 50 * tau)


def importance_ess(log_w: Array) -> float:
    """Kish's (sum w)^2 / sum w^2 for log weights (N,); -inf counts as weight 0."""
    w = np.exp(log_w - np.max(log_w))
    return float(w.sum() ** 2 / (w * w).sum())


def weight_maximum(log_w: Array) -> float:
    """Largest weight over the mean weight: a bound on how long an independence chain can stick."""
    return float(1 / np.mean(np.exp(log_w - np.max(log_w))))


def pareto_k(log_w: Array) -> float:
    """Shape of the weights' tail: below 0.5 their variance is finite, above 0.7 no estimate is to be trusted.

    Fitted to the largest min(N/5, 3 sqrt N) weights. NaN for fewer than 25 weights.
    """
    log_w = np.sort(np.asarray(log_w, float)[np.isfinite(log_w)])
    n = len(log_w)
    m = int(np.ceil(min(0.2 * n, 3 * np.sqrt(n))))
    if n < 25 or m < 5:
        return float("nan")
    w = np.exp(log_w - log_w[-1])
    excess = w[-m:] - w[-m - 1]
    return _pareto_shape(excess[excess > 0])


def geweke_stuck(x: Array) -> bool:
    """Whether some chain never moved."""
    return bool((np.ptp(np.atleast_2d(x), axis=1) == 0).any())


def _rhat(x: Array) -> float:
    n = x.shape[1]
    within = x.var(axis=1, ddof=1).mean()
    between = n * x.mean(axis=1).var(ddof=1)
    return float(np.sqrt((between / within + n - 1) / n)) if within > 0 else float("inf")


def _autocovariance(x: Array) -> Array:
    n = x.shape[1]
    size = 1 << (2 * n - 1).bit_length()
    centred = x - x.mean(1, keepdims=True)
    spectrum = np.fft.rfft(centred, size, axis=1)
    return np.fft.irfft(spectrum * np.conj(spectrum), size, axis=1)[:, :n] / n


def _ess(x: Array) -> float:
    """Geyer's initial monotone sequence over all (split) chains."""
    chains, n = x.shape
    if n < 4 or not np.isfinite(x).all():
        return float("nan")
    if np.ptp(x) < 1e-15 * max(1.0, abs(float(x.flat[0]))):
        return float(x.size)
    covariance = _autocovariance(x)
    within = covariance[:, 0].mean() * n / (n - 1)
    variance = within * (n - 1) / n + (x.mean(1).var(ddof=1) if chains > 1 else 0.0)
    rho = 1 - (within - covariance.mean(0)) / variance
    rho[0] = 1.0
    # pairs (rho_2k + rho_2k+1): the first one not positive ends the sequence, whose pairs then may not grow
    t = 1
    while t < n - 3 and rho[t - 1] + rho[t] > 0:
        t += 2
    last = t - 2  # -1: no pair at all
    pairs = np.minimum.accumulate(rho[0 : last + 1 : 2] + rho[1 : last + 2 : 2])
    following = max(rho[last + 1], 0.0) if last + 1 < n else 0.0
    tau = max(-1 + 2 * pairs.sum() + following, 1 / np.log10(x.size))
    return float(x.size / tau)


def _pareto_shape(x: Array) -> float:
    """Generalised Pareto shape of exceedances, sorted ascending (Zhang & Stephens 2009, with PSIS's weak prior)."""
    n = len(x)
    if n < 5:
        return float("nan")
    m = 30 + int(np.sqrt(n))
    b = 1 - np.sqrt(m / (np.arange(1, m + 1) - 0.5))
    b = b / (3 * x[int(n / 4 + 0.5) - 1]) + 1 / x[-1]
    k = np.mean(np.log1p(-b[:, None] * x), axis=1)
    profile = n * (np.log(-b / k) - k - 1)
    weight = 1 / np.exp(profile - profile[:, None]).sum(1)
    b_mean = np.sum(b * weight / weight.sum())
    shape = np.mean(np.log1p(-b_mean * x))
    return float((n * shape + 5) / (n + 10))
