"""The `lobes` fit as GGX lobes, which is what real-time and production shaders have."""

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

from gonio.brdf import Brdf, Ggx, Lambert, Mixture
from gonio.brdf.models.student import Student
from gonio.evaluate import evaluate
from gonio.export import ExportError, ExportWarning
from gonio.geometry import Array

GGX = 2.0  # its exponent among Student's


@dataclass(frozen=True)
class Lobe:
    """GGX roughnesses; colour (3,) at normal and at grazing incidence, Schlick between."""

    alpha_x: float
    alpha_y: float
    colour0: Array
    colour90: Array


@dataclass(frozen=True)
class Lobes:
    """A diffuse albedo (3,) and GGX lobes, narrow ones first."""

    diffuse: Array
    lobes: tuple[Lobe, ...]

    @classmethod
    def of(cls, fit: Brdf) -> "Lobes":
        """Student lobes become GGX ones of the same width at half maximum. Raises ExportError for another BRDF."""
        if not isinstance(fit, Mixture) or fit.channels != 3:
            raise ExportError("parameters are those of a `lobes` fit of three channels (R, G, B); nothing was written")
        diffuse, lobes = np.zeros(3), []
        for part in fit.parts:
            if isinstance(part, Lambert):
                diffuse = diffuse + part.albedo
            elif isinstance(part, Student | Ggx) and part.f0 is not None:
                gamma = getattr(part, "gamma", GGX)
                wider = float(np.sqrt((2 ** (1 / gamma) - 1) / (2 ** (1 / GGX) - 1)))
                alpha = np.clip(wider * np.array([part.ndf.alpha_x, part.ndf.alpha_y]), 1e-4, 1)
                lobes.append(Lobe(float(alpha[0]), float(alpha[1]), part.weight * part.f0, part.weight * np.ones(3)))
            else:
                raise ExportError(f"a part of kind {getattr(part, 'kind', '?')} has no parameters to write")
        return cls(diffuse, tuple(sorted((k for k in lobes if k.colour90.any()), key=lambda k: k.alpha_x)))

    def brdf(self) -> Mixture:
        """What a shader makes of it."""
        parts: list[Brdf] = [Lambert(self.diffuse)]
        for k in self.lobes:
            safe = np.where(k.colour90 > 0, k.colour90, 1)
            parts.append(Ggx(k.alpha_x, k.alpha_y, k.colour0 / safe, weight=k.colour90))
        return Mixture(parts)


def say_error(made: Any, reference: Brdf, what: str) -> float:
    """The energy error of parameters against the run's BRDF, as an ExportWarning: it is always worth knowing."""
    error = evaluate(made, reference, n=2000)["energy_mean"]
    warnings.warn(f"{what}: {error:.1%} of the reflected energy is in the wrong place", ExportWarning, stacklevel=3)
    return error
