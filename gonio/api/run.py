"""A run folder in the hands of a script."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gonio.api.plot import PlottedBrdf, plotted
from gonio.api.rig import Truth, as_brdf
from gonio.config import Material as MaterialConfig
from gonio.load import load_brdf
from gonio.reconstruct.samples import Samples
from gonio.run.record.config import RunConfig, read_config
from gonio.run.record.samples import load_samples
from gonio.run.record.store import Store

if TYPE_CHECKING:
    import xarray


def open_run(path: str | os.PathLike[str]) -> "Run":
    """The run in a folder that `gonio acquire` or `gonio.acquire` made. Raises StoreError, ConfigError."""
    folder = Path(path)
    config = read_config(folder)
    Store.open(folder, write=False).close()
    return Run(folder, config)


class Run:
    """A run folder, to be read; nothing in it is kept open. Made by `open_run`, `acquire`, `resume`."""

    def __init__(self, folder: Path, config: RunConfig):
        self.folder, self.config = folder, config

    @property
    def material(self) -> MaterialConfig:
        return self.config.material

    @property
    def samples(self) -> Samples:
        """All readings that gave a value: `wi`, `wo` (N, 3) as achieved, `f`, `sigma` (N, C) in 1/sr, no cosine,
        `saturated` (N,)."""
        with self._store() as store:
            return load_samples(store)

    @property
    def ended(self) -> str:
        """Why it ended; "" while it goes on or where it was interrupted."""
        with self._store() as store:
            return store.get("ended", "")

    @property
    def provenance(self) -> dict[str, Any]:
        """Versions, seed, host, rig, calibrations, truth."""
        with self._store() as store:
            return store.get("provenance", {})

    def to_xarray(self) -> "xarray.Dataset":
        """Every measurement with its angles in degrees, f and sigma by channel; see `gonio.export.dataset`.

        Raises MissingExtra where xarray is not installed.
        """
        from gonio.export.dataset import dataset

        with self._store() as store:
            return dataset(store, self.material)

    def brdf(self, model: str | None = None) -> PlottedBrdf:
        """The run's BRDF; its `brdf.npz` is made if there is none yet. With a `model`, that reconstruction, not saved.

        Raises ReconstructionError for too few samples, ConfigError for a model that does not exist.
        """
        from gonio.run.products import make_brdf, reconstruct_run

        if model is not None:
            return plotted(reconstruct_run(self.folder, model)[0])
        if not (self.folder / "brdf.npz").exists():
            make_brdf(self.folder)
        return plotted(load_brdf(self.folder))

    def evaluate(self, truth: Truth | None = None, model: str | None = None) -> dict[str, float]:
        """The referee's figures of its BRDF beside `truth` (a function, a BRDF, a name), or beside the run's own.

        Raises ConfigError where that is not known.
        """
        from gonio.evaluate import evaluate
        from gonio.run.products import truth_of

        return evaluate(self.brdf(model), truth_of(self.folder) if truth is None else as_brdf(truth))

    def report(self) -> Path:
        """report.html, made of what is there now."""
        from gonio.run.products import make_report

        self.brdf()
        return make_report(self.folder)

    def export(self, format: str, out: str | os.PathLike[str] | None = None) -> Path:
        """As `gonio export --format`; the path written."""
        from gonio.run.exports import export_run

        return export_run(self.folder, format, None if out is None else Path(out))

    def _store(self) -> Store:
        return Store.open(self.folder, write=False)

    def __repr__(self) -> str:
        return f"<run {self.folder}: {self.material.name} on {self.config.rig.name}>"
