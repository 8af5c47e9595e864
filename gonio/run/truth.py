"""The BRDF that a simulated rig shows: found by its name when a run starts, and known again by its bytes ever after.

A name finds another file where GONIO_MATERIALS or the cache is another: a run that went on with it would mix two
materials, and one that is compared with it would be judged by the wrong one.
"""

import hashlib
import os
from pathlib import Path

import gonio
from gonio.brdf import Brdf
from gonio.brdf.library import Found, find
from gonio.config import ConfigError, Material
from gonio.config.rig import RigConfig
from gonio.run.record.config import read_config
from gonio.run.record.store import Store

OWN = "the caller's own "


def find_truth(material: Material, rig: RigConfig, own: Brdf | None = None) -> tuple[Brdf | None, str]:
    """The BRDF a simulated rig shows and where it was found; (None, "") on a real rig. Raises ConfigError.

    own: shown in place of one that `truth` would name; a run does not keep it.
    """
    if rig.depth == "real":
        if material.truth is not None or own is not None:
            raise ConfigError(f"truth: rig {rig.name} is real and shows what lies on it; leave `truth` out")
        return None, ""
    if own is not None:
        if material.truth is not None:
            raise ConfigError(f"truth: {material.truth} is named by the material, and another is given; keep one")
        return own, f"{OWN}{getattr(own, 'name', type(own).__name__)}, which the run does not keep"
    if material.truth is None:
        raise ConfigError(f"truth: missing; rig {rig.name} is simulated and needs a BRDF to show")
    found = find(material.truth)
    return gonio.load_brdf(found.path), found.origin


def truth_sha256(material: Material) -> str:
    """SHA-256 of the file that the material's truth is read from; "" for a real sample, which has none."""
    return "" if material.truth is None else _sha256(find(material.truth))


def scene_sha256(material: Material) -> str:
    """SHA-256 of the file of the picture that the run is for; "" where there is none."""
    from gonio import picture

    scene = material.sampler.target.scene
    return "" if scene is None else picture.sha256(scene)


def refuse_another_scene(folder: str | os.PathLike[str]) -> None:
    """Raises ConfigError where the file of the run's picture is missing, or not the one it began with."""
    material = read_config(folder).material
    with Store.open(folder, write=False) as store:
        began = store.get("provenance", {}).get("scene_sha256", "")
    try:
        same = scene_sha256(material) == began
    except OSError:
        same = False
    if not same:
        scene = material.sampler.target.scene
        raise ConfigError(f"{folder}: {scene} is missing or not the file that the run began with; put that back")


def open_truth(name: str) -> Brdf:
    """A BRDF by path or by a material's name."""
    return gonio.load_brdf(find(name).path)


def own_truth(folder: str | os.PathLike[str]) -> Found | None:
    """The file of the BRDF that the rig showed when the run was made; None for a run on a real rig.

    Raises ConfigError where its name finds another file today.
    """
    name = read_config(folder).material.truth
    if name is None:
        return None
    with Store.open(folder, write=False) as store:
        began = store.get("provenance", {})
    found = find(name)
    if (then := began.get("truth_sha256")) and _sha256(found) != then:
        raise ConfigError(
            f"{folder}: its truth {name} was another file when it was measured ({began['truth']}; now {found.origin}); "
            f"set GONIO_MATERIALS as it was then"
        )
    return found


def _sha256(found: Found) -> str:
    path = Path(str(found.path))
    if not path.exists():  # one of several in a file
        path = Path(str(found.path).rpartition(":")[0])
    if not path.is_file():
        return ""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
