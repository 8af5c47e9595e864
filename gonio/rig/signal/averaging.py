"""How many readings make one average: enough for the sigma asked for, no more than the config allows.

The converter's steps average out where the noise under them reaches half a step (Widrow & Kollar 2008); else they stay.
"""

import numpy as np

from gonio.config.detectors import PhotodiodeConfig
from gonio.geometry import Array


def readings_needed(config: PhotodiodeConfig, light: Array, variance: Array, steps: Array, seconds: float) -> int:
    """Readings in all, the first one counted, of `seconds` each.

    light (C,) signal above dark; variance (C,) of one reading without the converter's steps, steps (C,) theirs. Every
    channel has to reach target_sigma * light, or target_sigma_floor where that is more.
    """
    if config.target_sigma is None:
        return 1
    most = max(min(config.max_readings, int(config.average_s / seconds)), 1)
    goal = np.maximum(config.target_sigma * light, config.target_sigma_floor) ** 2
    fading, staying = _parts(variance, steps)
    with np.errstate(divide="ignore"):
        n = np.where(goal > staying, fading / np.maximum(goal - staying, 1e-300), np.inf)
    return int(np.clip(np.ceil(n.max()), 1, most))


def sigma_of(variance: Array, steps: Array, readings: int) -> Array:
    """Sigma (C,) of the mean of so many readings."""
    fading, staying = _parts(variance, steps)
    return np.sqrt(fading / readings + staying)


def _parts(variance: Array, steps: Array) -> tuple[Array, Array]:
    """What averages out, and what does not."""
    dithered = variance >= 3 * steps  # a step is sqrt(12 steps) high
    return np.where(dithered, variance + steps, variance), np.where(dithered, 0.0, steps)
