"""Samples as they come from a rig -> samples a fit can rest on, or a refusal that says why."""

import numpy as np

from gonio.geometry import to_half_diff, unit
from gonio.reconstruct import ReconstructionError
from gonio.reconstruct.samples import Samples

FEWEST = 30


def clean(samples: Samples) -> Samples:
    """Finite, unit, above the horizon, replicates averaged; noise that is not a number counts as none.

    A replicate is the same pair of directions to 1e-7; the mean is weighted by 1/sigma**2. A saturated reading stays
    (it is a lower bound) unless the same pair was also read well. Raises ReconstructionError.
    """
    f = np.asarray(samples.f, float)
    wi, wo = np.asarray(samples.wi, float), np.asarray(samples.wo, float)
    ok = np.isfinite(f).all(1) & np.isfinite(wi).all(1) & np.isfinite(wo).all(1)
    ok &= (wi[:, 2] > 1e-6) & (wo[:, 2] > 1e-6)
    sigma = np.where(np.isfinite(samples.sigma) & (samples.sigma > 0), samples.sigma, 0.0)
    s = Samples(unit(wi[ok]), unit(wo[ok]), f[ok], sigma[ok], np.asarray(samples.saturated, bool)[ok])
    s = _replicates_averaged(s)
    values = ~s.saturated
    if values.sum() < FEWEST:
        raise ReconstructionError(
            f"{values.sum()} usable samples of {len(samples)}; {FEWEST} different ones are the least: measure more"
        )
    if not (s.f[values] > 0).any():
        raise ReconstructionError("every reading is zero or below; check the light, the shutter and the dark readings")
    theta_h, _, theta_d, _ = to_half_diff(s.wi[values], s.wo[values])
    spread = max(np.ptp(theta_h), np.ptp(theta_d), np.ptp(s.wi[values, 2] - s.wo[values, 2]))
    if spread < 0.01:
        raise ReconstructionError(
            f"all samples lie within {np.degrees(spread):.2g} degrees of one spot; measure at other angles too"
        )
    return s


def usable(samples: Samples) -> Samples:
    """The cleaned, unsaturated measurements, values below 0 (dark subtraction) set to 0. Raises ReconstructionError."""
    s = clean(samples)
    s = s[~s.saturated]
    return Samples(s.wi, s.wo, np.maximum(s.f, 0), s.sigma, s.saturated)


def _replicates_averaged(s: Samples) -> Samples:
    if not len(s):
        return s
    key = np.round(np.concatenate([s.wi, s.wo], 1) * 1e7).astype(np.int64)
    _, first, group = np.unique(key, axis=0, return_index=True, return_inverse=True)
    group = group.ravel()
    if len(first) == len(s):
        return s
    n = len(first)
    good = ~s.saturated
    has_good = np.bincount(group, good, n) > 0
    use = good | ~has_good[group]
    weight = np.where(s.sigma > 0, 1 / np.where(s.sigma > 0, s.sigma, 1) ** 2, 0.0)
    # a group with any noiseless reading counts its readings alike
    exact = np.bincount(group, (weight == 0).any(1) & use, n) > 0
    weight = np.where(exact[group, None], 1.0, weight) * use[:, None]
    sums = lambda v: np.stack([np.bincount(group, v[:, c], n) for c in range(v.shape[1])], 1)
    total = sums(weight)
    f = sums(weight * s.f) / total
    sigma = np.sqrt(sums((weight * s.sigma) ** 2)) / total
    return Samples(s.wi[first], s.wo[first], f, sigma, ~has_good)
