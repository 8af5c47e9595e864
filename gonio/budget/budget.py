"""The budget of one BRDF: at any pair, over strata, and of reflectance integrals."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from gonio.budget.common import Common
from gonio.budget.strata import STRATA, strata
from gonio.geometry import Array, from_angles

DRAWS = 2048  # of an integral


@dataclass(frozen=True)
class Reflectance:
    """Directional-hemispherical, at one theta_i (rad): value, u (k = 1), its random part, (C,) each; NaN = unknown."""

    theta_i: float
    value: Array
    u: Array
    random: Array


class Budget:
    """brdf knows `std` and `interval` of its own: the random part, and what was not looked at. band_errors(theta_i):
    the relative random error (C,) of a reflectance, None where nothing was drawn."""

    def __init__(self, brdf: Any, common: Common, band_errors=None, imported: bool = False):
        self.brdf, self.common, self._band_errors, self._imported = brdf, common, band_errors, imported

    @property
    def left_out(self) -> list[str]:
        """What is not in it, and what would bring it in."""
        unknown = "what the model misses, and noise: `gonio reconstruct --model auto` makes a BRDF that knows"
        own = [] if hasattr(self.brdf, "std") else [unknown]
        if self._imported:
            return [*own, "all that the instrument contributes that measured it: its laboratory knows"]
        return [*own, *self.common.left_out]

    def std(self, wi: Array, wo: Array) -> Array:
        """Standard uncertainty of f (N, C) in 1/sr, random and common parts together."""
        f = self.brdf.eval(wi, wo)
        own = self.brdf.std(wi, wo) if hasattr(self.brdf, "std") else np.zeros_like(f)
        return np.asarray(np.hypot(own, f * self.common.u(wi, wo)))

    def interval(self, wi: Array, wo: Array, level: float) -> tuple[Array, Array]:
        """(low, high), (N, C) in 1/sr: the reconstruction's own interval, widened by the common parts."""
        from scipy.stats import norm

        f = self.brdf.eval(wi, wo)
        shared = f * self.common.u(wi, wo) * norm.ppf(0.5 + level / 2)
        low, high = self.brdf.interval(wi, wo, level) if hasattr(self.brdf, "interval") else (f, f)
        return f - np.hypot(f - low, shared), f + np.hypot(high - f, shared)

    def parts(self, wi: Array, wo: Array) -> dict[str, Array]:
        """Relative standard uncertainty (N, C) of each part: `reconstruction` (noise, and what lies between readings),
        then the common ones."""
        f = np.maximum(self.brdf.eval(wi, wo), 1e-12)
        own = {"reconstruction": self.brdf.std(wi, wo) / f} if hasattr(self.brdf, "std") else {}
        shared = {k: np.sqrt((c**2).sum(0)) for k, c in self.common.columns(wi, wo).items()}
        return own | shared

    def by_stratum(self, wi: Array, wo: Array) -> dict[str, dict[str, float]]:
        """Part -> stratum -> median of its relative standard uncertainty over pairs and channels; `all` among them."""
        parts = self.parts(wi, wo)
        parts["combined"] = np.sqrt(sum(p**2 for p in parts.values()))
        return medians(parts, self.brdf, wi, wo)

    def reflectance(self, theta_i: float) -> Reflectance:
        """DHR = integral of f cos(theta_o); draws of the BRDF's own density (Sobol), the common columns integrated with
        their signs: what errs one way here and the other there cancels."""
        from scipy.stats import qmc

        u = qmc.Sobol(2, seed=7).random(DRAWS)
        wi = np.broadcast_to(from_angles(np.array([theta_i]), 0.0), (DRAWS, 3))
        wo, pdf = self.brdf.sample(wi, u)
        ok = (pdf > 0) & (wo[:, 2] > 0)
        weight = np.where(ok, np.maximum(wo[:, 2], 0) / np.where(ok, pdf, 1.0), 0.0)[:, None] / DRAWS
        f = self.brdf.eval(wi, wo)
        value = (weight * f).sum(0)
        columns = self.common.all_columns(wi[ok], wo[ok])
        shared = np.sqrt((np.einsum("knc,nc->kc", columns, (weight * f)[ok]) ** 2).sum(0))
        found = None if self._band_errors is None else self._band_errors(theta_i)
        random = value * found if found is not None and np.isfinite(found).all() else self._all_alike(wi, wo, weight)
        return Reflectance(theta_i, value, np.hypot(shared, random), random)

    def _all_alike(self, wi: Array, wo: Array, weight: Array) -> Array:
        """The random part where no draws tell it: as if all errors were one, which is too much."""
        std = self.brdf.std(wi, wo) if hasattr(self.brdf, "std") else np.full((len(wi), self.brdf.channels), np.nan)
        return np.asarray((weight * std).sum(0))


def medians(parts: dict[str, Array], brdf: Any, wi: Array, wo: Array) -> dict[str, dict[str, float]]:
    """Part -> stratum -> median of (N, C) values at pairs; `all` among them."""
    which = strata(brdf, wi, wo)
    return {
        name: {"all": float(np.median(p))}
        | {s: float(np.median(p[which == k])) for k, s in enumerate(STRATA) if (which == k).any()}
        for name, p in parts.items()
    }


def nodes(n: int = 600) -> tuple[Array, Array]:
    """Pairs (n, 3) all over both hemispheres, even in the angles from the normal: where a budget is looked at."""
    from scipy.stats import qmc

    u = qmc.Sobol(3, seed=3).random(1 << int(np.ceil(np.log2(n))))[:n]
    wi = from_angles(u[:, 0] * np.radians(80), np.zeros(n))
    return wi, from_angles(u[:, 1] * np.radians(80), 2 * np.pi * u[:, 2])
