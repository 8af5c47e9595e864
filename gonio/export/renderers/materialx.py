"""A `lobes` fit as a MaterialX document, `.mtlx` (specification 1.39, "Physically Based Shading Nodes").

oren_nayar_diffuse_bsdf plus a generalized_schlick_bsdf a lobe, added; `roughness` of these nodes is alpha itself.
Shaders that compensate for multiple scattering make rough lobes a little brighter.
"""

import os
from xml.etree import ElementTree as xml

from gonio.atomic import write_text
from gonio.brdf import Brdf
from gonio.export.renderers.lobes import Lobes, say_error


def write_materialx(fit: Brdf, path: str | os.PathLike, reference: Brdf | None = None) -> None:
    """fit: a `lobes` BRDF of three channels; reference: what its energy error is said against (ExportWarning).

    Raises ExportError.
    """
    lobes = Lobes.of(fit)
    root = xml.Element("materialx", version="1.39", colorspace="lin_rec709")
    top = _node(root, "oren_nayar_diffuse_bsdf", "diffuse", "BSDF", color=("color3", lobes.diffuse))
    for k, lobe in enumerate(lobes.lobes, 1):
        part = _node(
            root, "generalized_schlick_bsdf", f"lobe{k}", "BSDF",
            color0=("color3", lobe.colour0), color90=("color3", lobe.colour90), exponent=("float", [5.0]),
            roughness=("vector2", [lobe.alpha_x, lobe.alpha_y]), distribution=("string", "ggx"),
            scatter_mode=("string", "R"),
        )  # fmt: skip
        both = _node(root, "add", f"sum{k}", "BSDF")
        for name, node in (("in1", top), ("in2", part)):
            xml.SubElement(both, "input", name=name, type="BSDF", nodename=node.get("name", ""))
        top = both
    surface = _node(root, "surface", "surface1", "surfaceshader")
    xml.SubElement(surface, "input", name="bsdf", type="BSDF", nodename=top.get("name", ""))
    material = _node(root, "surfacematerial", "gonio", "material")
    xml.SubElement(material, "input", name="surfaceshader", type="surfaceshader", nodename="surface1")
    xml.indent(root)
    write_text(path, '<?xml version="1.0"?>\n' + xml.tostring(root, encoding="unicode") + "\n")
    if reference is not None:
        say_error(lobes.brdf(), reference, "MaterialX's lobes")


def _node(root: xml.Element, kind: str, name: str, type_: str, **inputs) -> xml.Element:
    node = xml.SubElement(root, kind, name=name, type=type_)
    for key, (what, value) in inputs.items():
        text = value if isinstance(value, str) else ", ".join(f"{v:.7g}" for v in value)
        xml.SubElement(node, "input", name=key, type=what, value=text)
    return node
