"""Counts -> BRDF.

    f = (S - D) / (t k g cos)

S the reading and D the dark reading of the same exposure t, freed of non-linearity; g the signal per second of f = 1 at
full projection, from a white reference of known f; k the lamp's drift since then, from repeats of a reference point;
cos = cos(theta_i) where the light overfills the detector's view (irradiance falls with it, the patch seen does not
change the radiance), cos(theta_o) where the detector sees the whole lit patch.

Sigma is the random part: that of S, of D, and of k. The calibration's own uncertainty is common to a run and stays
beside it (`gain_sigma`). Negative f is kept; a chain that must not see it takes max(0, f), which lies above f in the
mean by sigma phi(f/sigma) - f Phi(-f/sigma): 0.4 sigma where f is 0, 0.08 at f = sigma, 0.0004 at 3 sigma.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from gonio.geometry import Array
from gonio.rig.devices import Reading


@dataclass(frozen=True)
class Dark:
    """Mean of dark readings: signal (C,), its sigma (C,), their exposure in seconds."""

    value: Array
    sigma: Array
    exposure: float

    @classmethod
    def of(cls, readings: list[Reading]) -> "Dark":
        value = np.mean([r.value for r in readings], 0)
        sigma = np.sqrt(np.mean([r.sigma**2 for r in readings], 0) / len(readings))
        return cls(value, sigma, float(readings[0].raw["exposure_s"]))


@dataclass(frozen=True)
class Radiometry:
    """What a radiometric calibration knows. gain (C,) = signal / (s f cos); linearity = excess at full scale.

    ratios (R,) of the ranges to the lowest, stray (C,) signal a second of the lit lamp; None = 1, and none.
    """

    gain: Array
    gain_sigma: Array
    footprint: Literal["overfilled", "underfilled"] = "overfilled"
    linearity: float = 0.0
    id: str | None = None
    ratios: Array | None = None
    stray: Array | None = None

    def cosine(self, wi: Array, wo: Array) -> float:
        """Of one pair (3,), (3,): what the signal falls with besides f."""
        return float(wi[2] if self.footprint == "overfilled" else wo[2])

    def signal(self, reading: Reading) -> tuple[Array, Array]:
        """Value and sigma (C,) as a linear detector would have given them."""
        full, ranges = reading.raw.get("full_scale"), reading.raw.get("range")
        value, sigma = reading.value, reading.sigma
        if self.ratios is not None and ranges is not None:
            ratio = self.ratios[np.asarray(ranges, int)]
            value, sigma = value / ratio, sigma / ratio
        if not self.linearity or full is None:
            return value, sigma
        x = self.linearity / np.asarray(full, float)  # shown = s (1 + x s)
        root = np.sqrt(np.maximum(1 + 4 * x * value, 0.25))
        return 2 * value / (1 + root), sigma / root

    def reduce(
        self, reading: Reading, dark: Dark, wi: Array, wo: Array, drift: float = 1.0, drift_sigma: float = 0.0
    ) -> tuple[Array, Array]:
        """f and sigma (C,) in 1/sr of one reading at directions wi, wo (3,); NaN where either is below the horizon."""
        seconds = float(reading.raw["exposure_s"])
        value, sigma = self.signal(reading)
        scale = seconds / dark.exposure
        cosine = self.cosine(wi, wo)
        if not (wi[2] > 0 and wo[2] > 0):
            return np.full_like(value, np.nan), np.full_like(value, np.nan)
        per_f = seconds * drift * self.gain * cosine
        light = value - dark.value * scale
        if self.stray is not None:
            light = light - self.stray * seconds * drift
        noise = np.sqrt(sigma**2 + (dark.sigma * scale) ** 2 + (light * drift_sigma / drift) ** 2)
        return light / per_f, noise / per_f

    def expected(self, f: Array, wi: Array, wo: Array, seconds: float) -> Array:
        """The signal (C,) above dark that f (C,) will give."""
        return f * self.gain * seconds * max(self.cosine(wi, wo), 0.0)


def nominal(
    channels: int, exposure: float, footprint: Literal["overfilled", "underfilled"], linearity: float
) -> Radiometry:
    """For a detector whose unit is the signal of a white diffuser (f = 1/pi) at the normal in one exposure."""
    return Radiometry(np.full(channels, np.pi / exposure), np.zeros(channels), footprint, linearity)
