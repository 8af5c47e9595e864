"""The random parts of a run's readings, by what they come from: together they are the sigma that a run stores."""

from typing import Any

import numpy as np

from gonio.config.rig import RigConfig
from gonio.geometry import Array
from gonio.rig.signal.levels import READINGS

PARTS = ("repeatability", "dark", "quantisation")


def random_parts(
    raw: list[dict[str, Any]], wi: Array, wo: Array, f: Array, sigma: Array, gain: Array, config: RigConfig
) -> dict[str, Array]:
    """Relative standard uncertainty (N, C) of each of PARTS, for readings (N) of a photodiode, f (N, C) above 0.

    quantisation: a step of the converter in the range used, over the root of twelve, and of the readings averaged;
    dark: of the mean that was taken off; repeatability: the rest of sigma. gain (C,) signal a second of f = 1.
    """
    p = config.photodiode
    seconds = np.array([r["exposure_s"] for r in raw])[:, None]
    n = np.array([r.get("readings", 1) for r in raw])[:, None]
    step = np.array([r["full_scale"] for r in raw], float) / config.steps
    cosine = (wi if config.footprint == "overfilled" else wo)[:, 2:]
    per_f = np.maximum(seconds * gain * cosine, 1e-300) * np.maximum(f, 1e-12)
    quantisation = step / np.sqrt(12 * n) / per_f
    dark = np.broadcast_to(p.read_noise / np.sqrt(READINGS) * seconds / config.exposure_s, per_f.shape) / per_f
    whole = sigma / np.maximum(f, 1e-12)
    rest = np.sqrt(np.maximum(whole**2 - dark**2 - quantisation**2, 0.0))
    return dict(zip(PARTS, (rest, dark, quantisation)))
