"""Samples as they come from a rig -> samples a fit can rest on, or a refusal that says why."""

import numpy as np

from gonio.geometry import Array, to_half_diff, unit
from gonio.reconstruct.errors import ReconstructionError
from gonio.reconstruct.samples import Samples

FEWEST = 20
NOT_UNIT = 0.01  # a length further from 1 is another quantity than a direction
ROUNDING = 1e-5  # of a length: what is not worth a word
DARKEST, BRIGHTEST = 1e-305, 1e300  # of the brightest reading, of any: beyond, squares and ratios overflow


def remarks(samples: Samples) -> list[str]:
    """What `clean` does to samples that are not as they should be, a line each; empty where all is well."""
    wi, wo, sigma = (np.asarray(a, float) for a in (samples.wi, samples.wo, samples.sigma))
    f = np.asarray(samples.f, float)
    finite = np.isfinite(np.concatenate([wi, wo], 1)).all(1)
    length = np.linalg.norm(np.stack([wi, wo]), axis=-1)
    below = finite & ((wi[:, 2] <= 1e-6) | (wo[:, 2] <= 1e-6))
    found = [
        (~finite | ~np.isfinite(f).all(1), "without a finite value or direction are left out"),
        (below, "with a direction at or below the horizon are left out"),
        (np.isnan(sigma).any(1), "have a sigma that is not a number and are taken as free of noise"),
        (np.isposinf(sigma).any(1), "have an infinite sigma, which is no measurement, and are left out"),
        (finite & (np.abs(length - 1).max(0) > ROUNDING), "have directions up to a percent off unit length, made unit"),
    ]
    return [f"{np.count_nonzero(rows)} of {len(f)} samples {what}" for rows, what in found if rows.any()]


def refuse_nonsense(samples: Samples) -> None:
    """Raises ReconstructionError for numbers that cannot be what they are passed as, naming the first row."""
    wi, wo, f, sigma = (np.asarray(a, float) for a in (samples.wi, samples.wo, samples.f, samples.sigma))
    for name, d in (("wi", wi), ("wo", wo)):
        length = np.linalg.norm(d, axis=1)
        _refuse(np.abs(length - 1) > NOT_UNIT, f"{name}: a direction of length {{}}; give unit vectors", length)
    low = sigma.min(1, initial=0)
    _refuse(low < 0, "sigma: {}, a standard deviation below 0; give 0 where there is no noise, NaN if unknown", low)
    size = np.abs(f).max(1, initial=0)
    brightest = np.where(np.isfinite(size), size, 0).max(initial=0)
    out = (np.isfinite(size) & (size > BRIGHTEST)) | ((size > 0) & (brightest < DARKEST))
    _refuse(out, "f: {} 1/sr is no reflectance; check its unit", size)


def _refuse(rows: Array, words: str, values: Array) -> None:
    if rows.any():
        k = int(np.argmax(rows))
        raise ReconstructionError(f"sample {k}, {words.format(f'{values[k]:.4g}')} ({np.count_nonzero(rows)} such)")


def clean(samples: Samples) -> Samples:
    """Finite, unit, above the horizon, replicates averaged; `remarks` says what is done to the others.

    A replicate is the same pair of directions to 1e-7; the mean is weighted by 1/sigma**2. A saturated reading stays
    (it is a lower bound) unless the same pair was also read well. Raises ReconstructionError.
    """
    refuse_nonsense(samples)
    f = np.asarray(samples.f, float)
    wi, wo = np.asarray(samples.wi, float), np.asarray(samples.wo, float)
    ok = np.isfinite(f).all(1) & np.isfinite(wi).all(1) & np.isfinite(wo).all(1)
    ok &= (wi[:, 2] > 1e-6) & (wo[:, 2] > 1e-6)
    ok &= ~np.isposinf(samples.sigma).any(1)
    sigma = np.where(np.isfinite(samples.sigma), samples.sigma, 0.0)
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
