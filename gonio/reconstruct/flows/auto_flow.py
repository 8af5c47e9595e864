"""The value from `auto`, the renderer's density from a flow (the thesis's 7.2.5).

A wrong density costs a render noise, never its mean: so the flow may be rough where `auto` is not.
"""

import numpy as np

from gonio.flow.density import FlowDensity
from gonio.geometry import Array
from gonio.reconstruct.clean import clean
from gonio.reconstruct.flows.flow import FlowSampler, fit_density, floor_of
from gonio.reconstruct.samples import Samples
from gonio.reconstruct.splines import auto
from gonio.reconstruct.splines.auto import AutoBrdf


class AutoFlowBrdf:
    """`eval` and `std` of an AutoBrdf, `sample` and `pdf` of a flow."""

    kind = "auto_flow"

    def __init__(self, value: AutoBrdf, density: FlowDensity):
        self.value, self.density = value, density
        self.eval, self.std, self.notes = value.eval, value.std, value.notes
        self.energy_error_estimate = value.energy_error_estimate
        sampler = FlowSampler(density)
        self.sample, self.pdf = sampler.sample, sampler.pdf

    @property
    def channels(self) -> int:
        return self.value.channels

    def to_arrays(self) -> dict[str, Array]:
        value = {f"value.{k}": v for k, v in self.value.to_arrays().items()}
        return value | self.density.to_arrays()

    @classmethod
    def from_arrays(cls, d: dict[str, Array]) -> "AutoFlowBrdf":
        value = AutoBrdf.from_arrays({k[6:]: v for k, v in d.items() if k.startswith("value.")})
        return cls(value, FlowDensity.from_arrays(d))


def fit(samples: Samples, *, anisotropic: bool, rng: np.random.Generator) -> AutoFlowBrdf:
    """Raises ReconstructionError for samples too few or too poor."""
    value = auto.fit(samples, anisotropic=anisotropic, rng=rng)
    s = clean(samples)
    s = s[~s.saturated]
    g = np.maximum(s.f, 0) * s.wo[:, 2:3]
    share = np.maximum(g.mean(0), 1e-4 * g.mean(0).max())
    total = (g / share).mean(1)
    floor = floor_of(total, s.sigma * s.wo[:, 2:3] / share)
    return AutoFlowBrdf(value, fit_density(s.wi, s.wo, total, floor, "half", anisotropic, rng)[0])
