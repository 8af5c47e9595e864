"""A Mitsuba scene by path or by the name of one that ships, and with another material in the place of one."""

import xml.etree.ElementTree as tree
from pathlib import Path

from gonio.config import ConfigError
from gonio.config.find import SHIPPED

MOST_BYTES = 64 * 2**20
FOLDER = SHIPPED / "scenes"


def find_scene(name: str) -> Path:
    """Raises ConfigError, one line."""
    path = Path(name)
    if path.is_file():
        return path
    if path.name == name and (FOLDER / f"{name}.xml").is_file():
        return FOLDER / f"{name}.xml"
    known = ", ".join(sorted(p.stem for p in FOLDER.glob("*.xml")))
    raise ConfigError(f"{name}: no such file, and none of the scenes that ship ({known})")


def read_scene(path: Path) -> tree.Element:
    """Raises ConfigError."""
    try:
        if path.stat().st_size > MOST_BYTES:
            raise ConfigError(f"{path}: is larger than a scene's XML can be ({MOST_BYTES >> 20} MB)")
        text = path.read_text()
        if "<!ENTITY" in text:
            raise ConfigError(f"{path}: defines entities, which no scene of Mitsuba's needs; leave them out")
        root = tree.fromstring(text)
    except tree.ParseError as e:
        raise ConfigError(f"{path}: not XML ({e})") from None
    except (OSError, UnicodeDecodeError) as e:
        raise ConfigError(f"{path}: cannot be read ({e})".replace("\n", " ")) from None
    if root.tag != "scene":
        raise ConfigError(f"{path}: its first element is <{root.tag}>, a Mitsuba scene begins with <scene>")
    return root


def materials(root: tree.Element) -> list[str]:
    """The ids of the BSDFs that shapes can have."""
    return [name for b in root.iter("bsdf") if (name := b.get("id"))]


def the_bsdf(root: tree.Element, bsdf: str, path: Path) -> tree.Element:
    """Raises ConfigError where no BSDF has this id."""
    for element in root.iter("bsdf"):
        if element.get("id") == bsdf:
            return element
    known = ", ".join(materials(root)) or "none has an id"
    raise ConfigError(f"{path}: no <bsdf id={bsdf!r}>; there are: {known}; name one with --bsdf")


def put(root: tree.Element, bsdf: str, path: Path, material: str | None) -> str:
    """The scene's XML with a .bsdf file in the place of a BSDF; None: a grey diffuse one."""
    element = the_bsdf(root, bsdf, path)
    element.clear()
    element.set("type", "twosided")
    element.set("id", bsdf)
    inner = tree.SubElement(element, "bsdf", {"type": "diffuse" if material is None else "measured"})
    if material is None:
        tree.SubElement(inner, "spectrum", {"name": "reflectance", "value": "0.5"})
    else:
        tree.SubElement(inner, "string", {"name": "filename", "value": material})
    return tree.tostring(root, encoding="unicode")
