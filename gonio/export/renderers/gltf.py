"""A `lobes` fit as a glTF 2.0 material: one GGX lobe over a diffuse base, the nearest that there is to it.

Khronos, glTF 2.0, Appendix B: roughness = sqrt(alpha); a metal has F0 = base colour and nothing diffuse; of a
dielectric, KHR_materials_specular gives F0 = 0.04 specularColorFactor (up to 1), and its base is dimmed by 1 - max(F).
"""

import json
import os
from typing import Any

import numpy as np

import gonio
from gonio.atomic import write_text
from gonio.brdf import Brdf, Ggx
from gonio.brdf.models.fresnel import schlick
from gonio.evaluate import directions, evaluate
from gonio.export.renderers.lobes import Lobes, say_error
from gonio.geometry import Array, half_vector

F0 = 0.04  # of index 1.5
ALPHAS = np.geomspace(0.01, 1, 25)
FEW = 800  # directions of the search


class GltfBrdf:
    """What a glTF renderer makes of the parameters; base, f0 (3,)."""

    channels = 3

    def __init__(self, alpha: float, base: Array, f0: Array):
        self.alpha, self.base, self.f0 = alpha, base, f0
        self._lobe = Ggx(alpha, f0=f0)

    def eval(self, wi: Array, wo: Array) -> Array:
        c = np.einsum("ni,ni->n", wi, half_vector(wi, wo))
        dim = 1 - schlick(c, self.f0).max(1, keepdims=True)
        up = (wi[:, 2] > 0) & (wo[:, 2] > 0)
        return np.where(up[:, None], dim * self.base / np.pi, 0) + self._lobe.eval(wi, wo)


def write_gltf(fit: Brdf, path: str | os.PathLike, reference: Brdf | None = None) -> None:
    """fit: a `lobes` BRDF of three channels; reference: what its energy error is said against (ExportWarning).

    Raises ExportError.
    """
    target = Lobes.of(fit).brdf()
    best = min((nearest(target, a) for a in ALPHAS), key=lambda m: _error(m, target))
    pbr: dict = {"roughnessFactor": round(float(np.sqrt(best.alpha)), 6)}
    material: dict = {"name": "gonio", "pbrMetallicRoughness": pbr}
    document: dict = {"asset": {"version": "2.0", "generator": f"gonio {gonio.__version__}"}, "materials": [material]}
    metal = best.base.max() < 0.02 * best.f0.max()
    pbr |= {"metallicFactor": float(metal), "baseColorFactor": [*_rounded(best.f0 if metal else best.base), 1.0]}
    if not metal:
        material["extensions"] = {"KHR_materials_specular": {"specularColorFactor": _rounded(best.f0 / F0)}}
        document["extensionsUsed"] = ["KHR_materials_specular"]
    write_text(path, json.dumps(document, indent=1) + "\n")
    if reference is not None:
        say_error(best, reference, "glTF's one lobe")


def _error(made: Any, target: Brdf) -> float:
    return evaluate(made, target, n=FEW)["energy_mean"]


def nearest(target: Brdf, alpha: float) -> GltfBrdf:
    """Base and F0, each within 0..1, with the least squares of f cos(theta_o) in energy, for one roughness."""
    from scipy.optimize import lsq_linear

    plain, rising = Ggx(alpha), Ggx(alpha, f0=0.0)
    rows, want = [], []
    for wi, wo, weight, _ in directions(FEW):
        f = target.eval(wi, wo)
        scale = np.sqrt(np.maximum(weight, 0) * wo[:, 2] / np.maximum(f.mean(1), 1e-9))[:, None]
        grazing = rising.eval(wi, wo)  # Schlick's part that is there whatever F0 is
        rows.append(np.concatenate([np.full((len(wi), 1), 1 / np.pi), plain.eval(wi, wo) - grazing], 1) * scale)
        want.append((f - grazing) * scale)
    a, b = np.concatenate(rows), np.concatenate(want)
    found = np.array([lsq_linear(a, b[:, c], bounds=(0, 1)).x for c in range(3)])
    f0 = found[:, 1]
    base = np.clip(found[:, 0] / max(1 - float(f0.max()), 0.05), 0, 1)
    return GltfBrdf(float(alpha), base, f0)


def _rounded(values: Array) -> list[float]:
    return [round(float(v), 6) for v in values]
