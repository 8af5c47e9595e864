"""Open a BRDF, whatever it is saved as; save one."""

import os
from importlib import import_module
from pathlib import Path

from gonio.brdf import Brdf, BrdfFileError, MerlBrdf, NetworkBrdf, RglBrdf
from gonio.brdf.kinds import KINDS as MODEL_KINDS
from gonio.brdf.saved import FORMAT_VERSION, read_arrays, write_saved

KINDS = MODEL_KINDS | {
    "auto": "gonio.reconstruct.splines.auto:AutoBrdf",
    "tabulated": "gonio.reconstruct.tables.tabulate:TabulatedBrdf",
    "flow": "gonio.reconstruct.flows.flow:FlowBrdf",
    "flow_density": "gonio.flow.density:FlowDensity",
    "auto_flow": "gonio.reconstruct.flows.auto_flow:AutoFlowBrdf",
}
"""kind of a saved BRDF -> its class; a file names a kind, never a class, so it cannot make us import anything else."""


def load_brdf(path: str | os.PathLike) -> Brdf:
    """The BRDF at `path`: a run folder (its `brdf.npz`), a saved reconstruction `.npz`, an RGL `.bsdf`, a MERL
    `.binary`, `FILE.npz:NAME` (a network), or the name of a material (see `gonio.brdf.library`).

    Raises BrdfFileError, one line.
    """
    text = os.fspath(path)
    file, colon, network = text.rpartition(":")
    if colon and file.endswith(".npz"):
        return NetworkBrdf.from_file(file, network)
    if not os.path.exists(text):
        from gonio.brdf.library import find

        text = str(find(text).path)
    if os.path.isdir(text):
        saved = os.path.join(text, "brdf.npz")
        if not os.path.exists(saved):
            raise BrdfFileError(f"{text}: has no brdf.npz; make it with `gonio reconstruct {text}`")
        text = saved
    if os.path.exists(text) and not os.path.isfile(text):
        raise BrdfFileError(f"{text}: not a file; name a BRDF, or a material as `gonio materials` lists them")
    match Path(text).suffix:
        case ".bsdf":
            return RglBrdf.from_file(text)
        case ".binary":
            return MerlBrdf.from_file(text)
        case ".npz":
            return _load_saved(text)
        case ".yaml":
            from gonio.brdf.models.fitted import FittedBrdf, read_yaml

            d = read_yaml(text)
            if "surface" not in d:
                return FittedBrdf.read(text, d)
            from gonio.brdf.surfaces import read_surface

            return read_surface(text, d)
    raise BrdfFileError(f"{text}: not a BRDF; wanted a run folder, .npz, .bsdf, .binary, .yaml or FILE.npz:NAME")


def save_brdf(brdf, path: str | os.PathLike) -> None:
    """Save `brdf` (which has `kind` and `to_arrays()`) as an .npz without pickles; it appears whole or not at all."""
    if brdf.kind not in KINDS:
        raise ValueError(f"{brdf.kind!r} is not a kind of BRDF that could be opened again")
    write_saved(path, brdf.kind, brdf.to_arrays())


def _load_saved(path: str) -> Brdf:
    try:
        d = read_arrays(path)
    except (OSError, ValueError) as e:
        raise BrdfFileError(f"{path}: not a saved BRDF ({e}); make it again with `gonio reconstruct`") from None
    if "kind" not in d or "format_version" not in d:
        raise BrdfFileError(f"{path}: no 'kind' and 'format_version' in it; for a network write {path}:NAME")
    kind, version = str(d.pop("kind")), int(d.pop("format_version"))
    if version > FORMAT_VERSION:
        raise BrdfFileError(f"{path}: format {version}, this gonio reads up to {FORMAT_VERSION}; use a newer gonio")
    if kind not in KINDS:
        raise BrdfFileError(f"{path}: unknown kind of BRDF '{kind}'; known are {', '.join(KINDS)}; use a newer gonio")
    module, name = KINDS[kind].split(":")
    try:
        return getattr(import_module(module), name).from_arrays(d)
    except (KeyError, ValueError, IndexError, TypeError) as e:
        raise BrdfFileError(f"{path}: a '{kind}' with wrong or missing arrays ({e}); make it again") from None
