"""Renders in Mitsuba 3 with its stock `measured` plugin: path tracing with next-event estimation."""

import os
import warnings
from pathlib import Path

import numpy as np

from gonio.export.extra import needs
from gonio.geometry import Array
from gonio.render.environment import ENVIRONMENTS
from gonio.render.objects import preview

OBJECTS = ("sphere", "preview")
_said = False


def load_mitsuba():
    """mitsuba with an RGB variant that works here: llvm where LLVM >= 19 is found, else scalar (slower, the same).

    A variant of RGB that was chosen before is kept; another, spectral say, cannot read a table in RGB. LLVM 15 and 16
    abort the process at the first render, so the version is asked for first.
    """
    global _said
    drjit, mitsuba = needs("drjit", "render"), needs("mitsuba", "render")
    if not (mitsuba.variant() or "").endswith("_rgb"):
        version = _llvm_version(drjit)
        mitsuba.set_variant("llvm_ad_rgb" if version >= 19 else "scalar_rgb")
        if version < 19 and not _said:
            _said = True
            warnings.warn("no LLVM 19 or newer: rendering in scalar mode, slower but the same", stacklevel=2)
    return mitsuba


def render(
    bsdf: str | os.PathLike[str], what: str, environment: str, size: int = 256, spp: int = 256, seed: int = 0
) -> Array:
    """Linear RGB (size, size, 3) of `what` (OBJECTS) made of the material in a .bsdf file, under ENVIRONMENTS[…]."""
    mi = load_mitsuba()
    material = {"type": "measured", "filename": str(bsdf)}
    sky = {"type": "envmap", "bitmap": mi.Bitmap(ENVIRONMENTS[environment]().astype(np.float32))}
    scene = {"type": "scene", "integrator": {"type": "path", "max_depth": 4}, "light": sky}
    if what == "sphere":
        scene |= {"camera": _camera(mi, [0, 0, 6], 22, size, [0, 1, 0]), "ball": {"type": "sphere", "bsdf": material}}
    else:
        scene["camera"] = _camera(mi, [0.2, -5.5, 3.4], 34, size, [0, 0, 1], [-0.05, -0.2, 0.45])
        # the environment's up is y; the preview stands on z
        sky["to_world"] = mi.ScalarTransform4f().rotate([1, 0, 0], 90)
        for k, mesh in enumerate(preview()):
            scene[f"part{k}"] = _mesh(mi, mesh, {"type": "twosided", "inner": material})
    loaded = mi.load_dict(scene)
    return np.array(mi.render(loaded, spp=spp, seed=seed))[..., :3]


def _camera(mi, origin, fov: float, size: int, up, target=(0, 0, 0)) -> dict:
    film = {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}, "pixel_format": "rgb"}
    to_world = mi.ScalarTransform4f().look_at(origin=list(origin), target=list(target), up=list(up))
    return {"type": "perspective", "fov": fov, "to_world": to_world, "film": film, "sampler": {"type": "independent"}}


def _mesh(mi, mesh, material: dict):
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "part.obj"
        mesh.write_obj(path)
        return mi.load_dict({"type": "obj", "filename": str(path), "bsdf": material})


def _llvm_version(drjit) -> int:
    try:
        found = drjit.detail.llvm_version()
    except Exception:  # no library at all
        return 0
    return int(found[0] if isinstance(found, tuple | list) else str(found).split(".")[0] or 0)
