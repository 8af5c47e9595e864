"""A run in the formats of other programs, by name: its BRDF, its samples, or the parameters of a fit."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import gonio
from gonio.config import ConfigError
from gonio.export.colours import Ordered, as_rgb, rgb_order
from gonio.run.record.config import read_config
from gonio.run.record.samples import load_samples
from gonio.run.record.store import Store

SAMPLE_FORMATS = {
    "csv": ("gonio.export.samples", "write_csv", "samples.csv"),
    "parquet": ("gonio.export.samples", "write_parquet", "samples.parquet"),
    "events": ("gonio.export.events", "write_events", "events.jsonl"),
    "netcdf": ("gonio.export.netcdf", "write_netcdf", "chains.nc"),
    "json": ("gonio.export.exchange.brdf_json", "write_json", "samples.brdf"),
    "nexus": ("gonio.export.exchange.nexus", "write_nexus", "samples.nxs"),
}
BRDF_FORMATS = {
    "bsdf": ("gonio.export.bsdf", "write_bsdf", "brdf.bsdf"),
    "merl": ("gonio.export.merl", "write_merl", "brdf.binary"),
    "grid": ("gonio.export.grid", "write_grid", "grid.npz"),
    "mountain": ("gonio.export.mountain", "write_mountain", "mountain"),
    "zemax": ("gonio.export.exchange.zemax", "write_zemax", "zemax.bsdf"),
    "astm": ("gonio.export.exchange.astm", "write_astm", "brdf.astm"),
    "xml": ("gonio.export.renderers.radiance", "write_ttree", "brdf.xml"),
    "klems": ("gonio.export.renderers.radiance", "write_klems", "klems.xml"),
}
OF_CHANNELS = ("grid",)  # they name their channels, and need no order
FIT_FORMATS = {
    "gltf": ("gonio.export.renderers.gltf", "write_gltf", "material.gltf"),
    "materialx": ("gonio.export.renderers.materialx", "write_materialx", "material.mtlx"),
}


def export_run(folder: Path, format: str, out: Path | None = None, spectral: bool = False) -> Path:
    """Write the run's BRDF, its samples or the parameters of a fit, by a key of the tables above; the path written.

    spectral: a .bsdf of wavelengths instead of rgb. Warns (ExportWarning) of what the file cannot hold. Raises
    ConfigError, ExportError, MissingExtra.
    """
    _refuse_place(out, format)
    if spectral:
        if format != "bsdf":
            raise ConfigError(f"--spectral: only a .bsdf can be, not {format}")
        from gonio.export.bsdf import write_bsdf

        path = out or Path(folder) / "brdf_spectral.bsdf"
        write_bsdf(gonio.load_brdf(folder), path, spectral=True)
        return path
    if format in SAMPLE_FORMATS:
        module, function, name = SAMPLE_FORMATS[format]
        write = _function(module, function)
        with Store.open(folder, write=False) as store:
            brdf = gonio.load_brdf(folder) if (Path(folder) / "brdf.npz").exists() else None
            path, shared = out or Path(folder) / name, _shared(folder, brdf)
            return write(store, path, brdf, shared, **_about(write, folder))
    if format in BRDF_FORMATS:
        module, function, name = BRDF_FORMATS[format]
        write = _function(module, function)
        path = out or Path(folder) / name
        brdf = gonio.load_brdf(folder)
        write(brdf if format in OF_CHANNELS else as_rgb(brdf, _names(folder)), path, **_about(write, folder))
        return path
    if format in FIT_FORMATS:
        module, function, name = FIT_FORMATS[format]
        path = out or Path(folder) / name
        reference: Any = gonio.load_brdf(folder) if (Path(folder) / "brdf.npz").exists() else None
        order = rgb_order(_names(folder))
        if reference is not None and order != sorted(order):
            reference = Ordered(reference, order)
        _function(module, function)(_lobes(folder, order), path, reference)
        return path
    raise ConfigError(f"--format {format}: not one of {', '.join([*BRDF_FORMATS, *SAMPLE_FORMATS, *FIT_FORMATS])}")


def _refuse_place(out: Path | None, format: str) -> None:
    """Raises ConfigError for a place where no file, or no folder of files, can be put."""
    if out is None:
        return
    if not out.absolute().parent.is_dir():
        raise ConfigError(f"--out {out}: there is no folder {out.parent}; make it first")
    if format == "mountain" and out.exists() and not out.is_dir():
        raise ConfigError(f"--out {out}: is no folder, and {format} writes several files; name another")
    if format != "mountain" and out.exists() and not out.is_file():
        raise ConfigError(f"--out {out}: is {'a folder' if out.is_dir() else 'no plain file'}; name a file in it")


def _names(folder: Path) -> tuple[str, ...]:
    return read_config(folder).material.channels


def _lobes(folder: Path, order: list[int]):
    """The `lobes` fit of a run's samples, their channels in an order."""
    from gonio.reconstruct import reconstruct

    config = read_config(folder).material
    with Store.open(folder, write=False) as store:
        s = load_samples(store)
    samples = replace(s, f=s.f[:, order], sigma=s.sigma[:, order])
    return reconstruct(samples, "lobes", anisotropic=config.symmetry == "anisotropic", seed=config.seed)


def _about(write, folder: Path) -> dict[str, Any]:
    """What people said of the sample, for a writer that has a place for it."""
    from inspect import signature

    from gonio.export.about import about

    return {"about": about(read_config(folder).material)} if "about" in signature(write).parameters else {}


def _shared(folder: Path, brdf):
    """Relative uncertainty (N, C) at pairs that all readings of a run have in common; None of a rig never
    calibrated."""
    from gonio.budget import budget_of

    if brdf is None:
        return None
    common = budget_of(folder).common
    return common.u if common.calibrated else None


def _function(module: str, name: str):
    from importlib import import_module

    return getattr(import_module(module), name)
