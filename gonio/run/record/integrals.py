"""The albedos of a run, by band of theta_i, with their standard errors: no truth needed."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from gonio.config.material import Material
from gonio.geometry import Array
from gonio.reconstruct.integrals import EDGES, Albedo, albedo
from gonio.run.record.draws import load_draws
from gonio.run.record.samples import load_samples
from gonio.run.record.store import Store

SHOWN = 8  # channels in a line of text


@dataclass(frozen=True)
class AlbedoOfRun:
    """channels, and what all draws of the run say of them; None where there are too few draws."""

    channels: tuple[str, ...]
    found: Albedo | None

    @classmethod
    def of(cls, store: Store, material: Material) -> "AlbedoOfRun":
        m = store.measured()
        anisotropic = material.symmetry == "anisotropic"
        return cls(material.channels, albedo(load_samples(store, m), load_draws(store, m), anisotropic=anisotropic))

    def rows(self) -> dict[str, str]:
        """A line for each band and one for even light: value and standard error of each channel."""
        if (a := self.found) is None:
            return {}
        edges = np.degrees(EDGES)
        names = [f"albedo, θi {low:.0f}–{high:.0f}°" for low, high in pairwise(edges)]
        lines = [*zip(a.value, a.error), (a.white[0], a.white[1])]
        return {name: self._line(*values) for name, values in zip([*names, "albedo, even light"], lines)}

    def _line(self, value: Array, error: Array) -> str:
        shown = "  ".join(f"{c} {v:.4f} ± {e:.4f}" for c, v, e in zip(self.channels[:SHOWN], value, error))
        return shown if len(self.channels) <= SHOWN else f"{shown}  … {len(self.channels)} channels"

    def to_json(self) -> dict[str, Any]:
        """Bands by their edges in degrees; values and errors (bands, channels)."""
        if (a := self.found) is None:
            return {}
        white = {"albedo_even_light": a.white[0].tolist(), "albedo_even_light_error": a.white[1].tolist()}
        bands = {"albedo_edges_deg": np.degrees(EDGES).round(6).tolist(), "albedo": a.value.tolist()}
        return bands | {"albedo_error": a.error.tolist()} | white
