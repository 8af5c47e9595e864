"""Sums of BRDFs."""

import numpy as np

from gonio.brdf.base import Brdf
from gonio.geometry import Array


class Mixture:
    """f = the sum of `parts`, all with the same number of channels; part k draws wo with probability share[k]."""

    kind = "mixture"

    def __init__(self, parts: list[Brdf], share=None):
        if len({p.channels for p in parts}) != 1:
            raise ValueError(f"the parts have {[p.channels for p in parts]} channels; one number wanted")
        self.parts = list(parts)
        share = np.ones(len(parts)) if share is None else np.asarray(share, float)
        self.share = share / share.sum()

    @property
    def channels(self) -> int:
        return self.parts[0].channels

    def eval(self, wi: Array, wo: Array) -> Array:
        return np.sum([p.eval(wi, wo) for p in self.parts], axis=0)

    def pdf(self, wi: Array, wo: Array) -> Array:
        return np.sum([s * p.pdf(wi, wo) for s, p in zip(self.share, self.parts)], axis=0)

    def sample(self, wi: Array, u: Array) -> tuple[Array, Array]:
        edges = np.concatenate([[0], np.cumsum(self.share)])
        edges[-1] = 1
        part = np.clip(np.searchsorted(edges, u[:, 0], "right") - 1, 0, len(self.parts) - 1)
        v = np.clip((u[:, 0] - edges[part]) / (edges[part + 1] - edges[part]), 0, 1 - 1e-16)
        wo = np.zeros((len(wi), 3))
        for k, p in enumerate(self.parts):
            mine = part == k
            if mine.any():
                wo[mine], _ = p.sample(wi[mine], np.stack([v[mine], u[mine, 1]], -1))
        return wo, self.pdf(wi, wo)

    def to_arrays(self) -> dict[str, Array]:
        d: dict[str, Array] = {"share": self.share, "kinds": np.array([_kind(p) for p in self.parts])}
        for k, p in enumerate(self.parts):
            d |= {f"part{k}.{key}": v for key, v in p.to_arrays().items()}  # type: ignore[attr-defined]
        return d

    @classmethod
    def from_arrays(cls, d: dict[str, Array]) -> "Mixture":
        from gonio.brdf.kinds import class_of

        parts = []
        for k, kind in enumerate(d["kinds"]):
            start = f"part{k}."
            mine = {name[len(start) :]: v for name, v in d.items() if name.startswith(start)}
            parts.append(class_of(str(kind)).from_arrays(mine))
        return cls(parts, d["share"])


def _kind(brdf: Brdf) -> str:
    return brdf.kind  # type: ignore[attr-defined]
