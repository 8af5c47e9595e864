"""Asks physics whether a file was understood: reciprocity, energy, the horizon, and where the gloss is.

Reciprocity: at (wi, wo) and (wo, wi) f is the same, f cos(theta_o) is not. Over pairs of readings that are nearly each
other's exchange,  log(v / v') = s log(cos theta_o / cos theta_o'):  s = 0 for f, 1 for f cos(theta_o), -1 for values
that were divided by a cosine which was not in them. Energy: the integral of f cos(theta_o) over wo is at most 1; a
reflectance factor (pi f) taken as f shows pi times too much. Slopes between 0 and -1 are no contradiction: a BRDF made
of few measurements has them, too.
"""

from dataclasses import dataclass

import numpy as np

from gonio.evaluate import directions
from gonio.geometry import Array, to_half_diff

LOOKED_AT = 6000  # readings
FEWEST = 40  # pairs that say something
NEAR = 0.25  # distance in `_place` up to which two readings are at one place
SLANT = 0.2  # of |log(cos theta_i / cos theta_o)|: below, the two hypotheses hardly differ
BRIGHT = 0.8  # power of the value that a pair counts with
UNTRIED = "too few readings are each other's exchange (light and detector): reciprocity is not tested"
SURER = 0.2  # the same of a slope below 0, which a BRDF made of few measurements has by itself
SURE = 0.45  # half width of the interval of 95 % of s
TOO_MUCH = 1.15  # reflectance
NORMAL_DEG = 1.6  # all directions within this of the normal: radians read as degrees
TURNED, RANGES = 40_000, 18  # readings among which azimuths are compared, and ranges of them in half a turn
BELOW = 0.25  # share of directions below the horizon


@dataclass(frozen=True)
class Doubts:
    """lines: what contradicts the reading of the file, empty where nothing does; slope: s with the half width of its
    interval (95 %), NaN where too few pairs say it; reflectance: the largest of the incidences, NaN likewise; notes:
    what could not be asked."""

    lines: tuple[str, ...]
    slope: float
    slope_u: float
    reflectance: float
    notes: tuple[str, ...] = ()


def doubts(wi: Array, wo: Array, f: Array, below: int, quantity: str, isotropic: bool = True) -> Doubts:
    """Of N usable readings f (N, C) in 1/sr, taken from values of `quantity`; below: how many more had a direction
    below the horizon."""
    lines = []
    if below > BELOW * (below + len(f)):
        lines.append(
            f"{below} of {below + len(f)} readings have a direction below the horizon: degrees taken as radians, "
            "or transmission?"
        )
    if len(f) == 0:
        return Doubts(tuple(lines), np.nan, np.nan, np.nan)
    widest = np.degrees(np.arccos(np.clip(min(wi[:, 2].min(), wo[:, 2].min()), -1, 1)))
    if widest < NORMAL_DEG and len(f) > 1:
        lines.append(f"all directions lie within {widest:.2g} degrees of the normal: radians taken as degrees?")
    rng = np.random.default_rng(0)
    some = rng.permutation(len(f))[:LOOKED_AT]
    wi, wo, f = wi[some], wo[some], f[some]
    v = f.mean(1)
    good = v > 0
    wi, wo, f, v = wi[good], wo[good], f[good], v[good]
    if (line := _mirror(wi, wo, v)) is not None:
        return Doubts((*lines, line), np.nan, np.nan, np.nan)  # the others would be of a wrong geometry
    slope, u = _slope(wi, wo, np.log(v), rng)
    if u < SURE and (slope > max(0.5, 0.3 + u) or (u < SURER and slope < -0.8 and slope - u < -0.9)):
        lines.append(_of_slope(slope, u, quantity))
    reflectance = _reflectance(wi, wo, f) if isotropic or len(f) > 500 else np.nan
    if reflectance > TOO_MUCH:
        lines.append(_of_energy(reflectance, quantity))
    notes = () if u < SURE else (UNTRIED,)
    return Doubts(tuple(lines), slope, u, reflectance, notes)


def _of_slope(s: float, u: float, quantity: str) -> str:
    text = f"reciprocity is broken as cos(theta_o)^{s:.2f} ± {u:.2f}"
    if s > 0:
        return text + ": the values look like f cos(theta_o), not f (--value f_cos)"
    if quantity in ("f_cos", "counts"):
        return text + ": the values look like f itself, without the cosine (--value f)"
    return text + ": the values are too large towards grazing theta_o"


def _of_energy(reflectance: float, quantity: str) -> str:
    text = f"more light comes off than falls on it, {reflectance:.2f} times as much"
    if quantity in ("f", "f_cos") and reflectance / np.pi < TOO_MUCH:
        return text + ": is it a reflectance factor, pi f (--value factor)?"
    return text + ": check the quantity and the scale (--value, --scale)"


def _place(wi: Array, wo: Array) -> Array:
    """(N, 3): where a pair of directions is, alike for mirror images and exchanges on an isotropic surface."""
    theta_h, _, theta_d, phi_d = to_half_diff(wi, wo)
    folded = np.abs(phi_d)
    folded = np.minimum(folded, np.pi - folded)
    return np.stack([0.7 * np.log(theta_h + 0.02), theta_d, folded * np.sin(theta_d)], 1)


def _slope(wi: Array, wo: Array, log_v: Array, rng: np.random.Generator) -> tuple[float, float]:
    """s of the module's text and the half width of its interval (95 %, bootstrap); NaN where too few pairs are near."""
    from scipy.spatial import cKDTree

    tilt = np.log(np.maximum(wi[:, 2], 1e-3) / np.maximum(wo[:, 2], 1e-3))
    one, other = np.flatnonzero(tilt > SLANT), np.flatnonzero(tilt < -SLANT)
    if min(len(one), len(other)) < FEWEST:
        return np.nan, np.nan
    place = _place(wi, wo)
    distance, k = cKDTree(place[other]).query(place[one])
    near = distance <= min(NEAR, max(np.quantile(distance, 0.5), 1e-6))
    if near.sum() < FEWEST:
        return np.nan, np.nan
    a, b = one[near], other[k[near]]
    q = np.log(np.maximum(wo[a, 2], 1e-3) / np.maximum(wo[b, 2], 1e-3))
    keep = np.abs(q) > SLANT
    if keep.sum() < FEWEST:
        return np.nan, np.nan
    bright = np.exp(BRIGHT * ((log_v[a] + log_v[b]) / 2 - log_v.max()))  # where it is dark, offsets are all there is
    ratio, weight = ((log_v[a] - log_v[b]) / q)[keep], (np.abs(q) * bright)[keep]
    draws = rng.integers(0, len(ratio), (100, len(ratio)))
    spread = [_weighted_median(ratio[i], weight[i]) for i in draws]
    return _weighted_median(ratio, weight), 1.96 * float(np.std(spread)) + 0.02


def _weighted_median(x: Array, w: Array) -> float:
    order = np.argsort(x)
    total = np.cumsum(w[order])
    return float(x[order][np.searchsorted(total, total[-1] / 2)])


def _reflectance(wi: Array, wo: Array, f: Array) -> float:
    """The largest, over channels, of the median over incidences; only where readings are near (from below, that is)."""
    from scipy.spatial import cKDTree

    if len(f) < FEWEST:
        return np.nan
    tree = cKDTree(_place(wi, wo))
    log_f = np.log(np.maximum(f, 1e-12 * f.max()))
    found = []
    for a, b, weight, _ in directions(1500):
        distance, k = tree.query(_place(a, b), k=min(3, len(f)))
        share = 1 / (distance + 1e-3)
        share /= share.sum(1, keepdims=True)
        value = np.exp(np.einsum("nk,nkc->nc", share, log_f[k]))
        seen = distance[:, 0] < NEAR
        found.append((value * (weight * b[:, 2] * seen)[:, None]).sum(0))
    return float(np.median(found, 0).max())


def _mirror(wi: Array, wo: Array, v: Array) -> str | None:
    """A line where the values grow towards the light and not towards the mirror direction."""
    slanting = wi[:, 2] < np.cos(np.radians(15))
    if slanting.sum() < FEWEST:
        return None
    a, b, v = wi[slanting], wo[slanting], v[slanting]
    mirror = a * np.array([-1.0, -1.0, 1.0])
    to_mirror, to_light = (np.einsum("ni,ni->n", b, w) for w in (mirror, a))
    if min(np.ptp(to_mirror), np.ptp(to_light)) < 1e-6 or np.ptp(v) == 0:
        return None
    towards_mirror, towards_light = (_rank_correlation(c, v) for c in (to_mirror, to_light))
    if towards_light > 0.5 and towards_light > towards_mirror + 0.3:
        return "it shines back to the light, not to the mirror direction: is the azimuth the other way (--specular)?"
    return None


def _rank_correlation(x: Array, y: Array) -> float:
    """Spearman's; equal values share their mean rank."""
    ranks: list[Array] = []
    for values in (x, y):
        _, group, size = np.unique(values, return_inverse=True, return_counts=True)
        ranks.append((np.cumsum(size) - (size - 1) / 2)[group])
    x, y = (r - r.mean() for r in ranks)
    return float((x * y).sum() / np.sqrt((x * x).sum() * (y * y).sum()))


def turns_with_sample(wi: Array, wo: Array, f: Array) -> bool:
    """Whether readings at one place of the isotropic frame differ more where the light's azimuths are further apart.

    Each of some readings is compared with the nearest of its own azimuths, and with the nearest of each other range of
    azimuths where that is no further away: on a lattice those stand at the very same place. Most of a dull surface
    hardly turns, so that a quantile above the median counts too.
    """
    from scipy.spatial import cKDTree

    some = np.random.default_rng(0).permutation(len(f))[:TURNED]
    slanting = some[(wi[some, 2] < 0.99) & (f[some].mean(1) > 0)]
    if len(slanting) < 4 * FEWEST:
        return False
    a, b, v = wi[slanting], wo[slanting], np.log(f[slanting].mean(1))
    phi = np.arctan2(a[:, 1], a[:, 0]) % np.pi  # turned by half a turn, most surfaces are the same
    group = np.round(phi / np.pi * RANGES).astype(int) % RANGES
    place = _place(a, b)
    asked = np.arange(min(len(v), LOOKED_AT // 2))
    near, near_by = np.full((2, len(asked)), np.nan)
    far, far_by = [], []
    for g in range(RANGES):
        members = np.flatnonzero(group == g)
        if len(members) < 3:
            continue
        distance, k = cKDTree(place[members]).query(place[asked], k=2)
        other = (members[k[:, 0]] == asked).astype(int)  # not itself
        distance, k = distance[asked, other], members[k[asked, other]]
        difference = np.abs(v[k] - v[asked])
        own = group[asked] == g
        near[own], near_by[own] = difference[own], distance[own]
        gap = np.abs(np.angle(np.exp(2j * (phi[k] - phi[asked])))) / 2
        far.append(difference)
        far_by.append(np.where(gap > np.radians(20), distance, np.inf))
    if not far:
        return False
    row, at = np.nonzero(np.array(far_by) <= 1.2 * near_by + 1e-6)
    if len(np.unique(at)) < FEWEST:
        return False
    apart, beside = np.quantile(np.array(far)[row, at], (0.5, 0.8)), np.quantile(near[at], (0.5, 0.8))
    return bool((apart > 1.25 * beside + 0.05).any() or apart[0] > 1.5 * beside[0] + 0.02)
