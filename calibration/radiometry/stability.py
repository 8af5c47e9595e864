"""How steady a lamp is: its drift once it is warm, and how long that takes."""

from dataclasses import dataclass

import numpy as np

from gonio.geometry import Array

LATE = 0.5  # of the time: the lamp is taken to be warm then
PRIOR = 0.05 / 3600  # of a drift, relative in a second
OUT = 4.0  # sigmas off the late line: not yet warm


@dataclass(frozen=True)
class Stability:
    """drift: relative in a second, and its sigma; warm_s: after which signals keep to the line, 0 if from the start;
    times (N,) s and signals (N,) in relation to the line's start, sigma of one: for the picture."""

    drift: float
    drift_sigma: float
    warm_s: float
    times: Array
    signals: Array
    sigma: float


def stability(times: Array, signals: Array) -> Stability:
    """From readings (N,) of all channels together at times (N,) s; three at least, else only the prior speaks."""
    if len(times) < 6:
        return Stability(0.0, PRIOR, 0.0, times, signals / max(signals.mean(), 1e-300), 0.0)
    warm = times >= times[0] + LATE * (times[-1] - times[0])
    line = _line(times[warm], signals[warm])
    off = signals / np.polyval(line, times) - 1
    noise = 1.4826 * float(np.median(np.abs(off[warm]))) + 1e-12
    steps = np.array_split(np.arange(len(times)), max(len(times) // 5, 1))
    early = [k for k, some in enumerate(steps) if abs(off[some].mean()) > OUT * noise / np.sqrt(len(some))]
    begin = int(steps[early[-1]][-1]) + 1 if early else 0
    settled = np.arange(len(times)) >= min(begin, len(times) // 2)
    line = _line(times[settled], signals[settled])
    at_start = float(np.polyval(line, times[0]))
    t = times[settled]
    sigma = noise / np.sqrt(len(t)) / max(float(t.std()), 1e-9)
    warm_s = float(times[begin] - times[0]) if 0 < begin < len(times) else 0.0
    weight = 1 / (1 + (sigma / PRIOR) ** 2)  # drawn to 0 where the readings hardly tell
    return Stability(
        weight * float(line[0]) / at_start, float(np.sqrt(weight)) * sigma, warm_s, times, signals / at_start, noise
    )


def _line(t: Array, y: Array) -> Array:
    """Slope and value at t = 0; by medians of pairs (Theil 1950), which one spike does not move."""
    from scipy.stats import theilslopes

    fit = theilslopes(y, t)
    return np.array([fit.slope, fit.intercept])
