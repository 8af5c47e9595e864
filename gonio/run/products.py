"""What is made of a run folder: brdf.npz, brdf.bsdf, report.html, tables, scores. All can be made again at any time."""

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gonio
from gonio.brdf import Brdf
from gonio.brdf.library import find
from gonio.config import ConfigError
from gonio.run.exports import export_run
from gonio.run.record.config import read_config
from gonio.run.record.samples import load_samples
from gonio.run.record.store import Store
from gonio.run.scan import make_scan_products, scan_of
from gonio.run.truth import open_truth, own_truth, refuse_another_scene

if TYPE_CHECKING:
    from gonio.brdf import Brdf
    from gonio.run.record.integrals import AlbedoOfRun


def make_brdf(folder: Path, model: str | None = None, out: Path | None = None) -> str:
    """Reconstruct and save; lines that say what was made and where. Raises ReconstructionError, ConfigError."""
    from gonio.load import save_brdf
    from gonio.reconstruct import ReconstructionWarning

    model = model or read_config(folder).material.reconstruct.model
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ReconstructionWarning)
        brdf, count = reconstruct_run(folder, model)
    path = out or Path(folder) / "brdf.npz"
    save_brdf(brdf, path)
    notes = [f"note   {w.message}" for w in caught if issubclass(w.category, ReconstructionWarning)]
    return "\n".join([f"brdf   {path}  ({model}, from {count} measurements)", *notes])


def reconstruct_run(folder: Path, model: str) -> "tuple[Brdf, int]":
    """The BRDF of a run's samples, and how many they are; nothing is saved. Raises ReconstructionError, ConfigError."""
    from gonio.reconstruct import MODELS, reconstruct

    if model not in MODELS:
        raise ConfigError(f"--model {model}: not one of {', '.join(MODELS)}")
    config = read_config(folder).material
    with Store.open(folder, write=False) as store:
        samples = load_samples(store)
    return reconstruct(samples, model, anisotropic=config.symmetry == "anisotropic", seed=config.seed), len(samples)


def make_products(folder: Path) -> list[str]:
    """Everything a user expects after an acquisition: the BRDF, its .bsdf, the report; how good it is stands first. Of
    a scan, its table and its plot: most make no BRDF."""
    with Store.open(folder, write=False) as store:
        if scan_of(store) is not None:
            return make_scan_products(folder)
    made = [make_brdf(folder), f"bsdf   {export_run(folder, 'bsdf')}", f"report {make_report(folder)}"]
    return [judge(folder), *made]


def judge(folder: Path) -> str:
    """The verdict on a run's BRDF and what was found wrong with it, in lines."""
    from gonio.render.verdict import verdict

    config = read_config(folder)
    with Store.open(folder, write=False) as store:
        m = store.measured()
        samples = load_samples(store, m)
    failed, imported = len(m.id) - len(samples), config.imported is not None
    v = verdict(gonio.load_brdf(folder), samples, config.material, failed, imported)
    return "\n".join(line.replace("RUN", str(folder)) for line in [v.line, *v.findings])


def evaluate_run(path: str, truth: str | None) -> dict[str, float]:
    """The referee's figures of a run or BRDF file against `truth`, a path or a name; None = the run's own."""
    from gonio.evaluate import evaluate

    reference = truth_of(path) if truth is None else open_truth(truth)
    brdf = gonio.load_brdf(path)
    if brdf.channels != reference.channels:
        raise ConfigError(f"--truth {truth}: has {reference.channels} channels, {path} has {brdf.channels}")
    return evaluate(brdf, reference) | _in_the_picture(path, brdf, reference)


def _in_the_picture(path: str, brdf: Brdf, truth: Brdf) -> dict[str, float]:
    """`scene_error`, the share of the light off the material that is wrong in the picture that a run was for."""
    from gonio import picture

    if not (Path(path) / "config.yaml").is_file():
        return {}
    if (scene := read_config(path).material.sampler.target.scene) is None:
        return {}
    refuse_another_scene(path)
    seen = picture.load(scene)
    f = truth.eval(seen.wi, seen.wo)
    return {"scene_error": seen.error(abs(brdf.eval(seen.wi, seen.wo) - f), f)}


def truth_of(path: str | Path) -> "Brdf":
    """What the rig showed when a run was made. Raises ConfigError where that is not known."""
    if not (Path(path) / "config.yaml").is_file():
        raise ConfigError(f"{path}: not a run folder; say what to compare it with by --truth")
    own = own_truth(path)
    if own is None:
        raise ConfigError(f"{path}: what it measured is in no file; say what to compare it with by --truth")
    return open_truth(str(own.path))


def albedo_of_run(path: str) -> "AlbedoOfRun":
    """The albedos of a run folder; of a BRDF file nothing was drawn, and there are none."""
    from gonio.run.record.integrals import AlbedoOfRun

    if not (Path(path) / "config.yaml").is_file():
        return AlbedoOfRun((), None)
    with Store.open(path, write=False) as store:
        return AlbedoOfRun.of(store, read_config(path).material)


def make_budget(folder: Path, theta_i_deg: tuple[float, ...] | None = None) -> dict:
    """budget.json in the run, as a dictionary. Raises ConfigError where the run has no BRDF yet."""
    from gonio.budget import budget_of, write_budget

    if not (Path(folder) / "brdf.npz").exists():
        raise ConfigError(f"{folder}: has no brdf.npz yet; `gonio reconstruct {folder}` makes it")
    return write_budget(folder, budget_of(folder), theta_i_deg)


def make_report(folder: Path) -> Path:
    """report.html, self-contained."""
    from gonio.render.report import write_report

    config = read_config(folder)
    own = own_truth(folder)
    truth = None if own is None else gonio.load_brdf(own.path)
    path = Path(folder) / "report.html"
    with Store.open(folder, write=False) as store:
        write_report(path, store, config.material, gonio.load_brdf(folder), truth, _run_flow(folder), _budget(folder))
    return path


def _budget(folder: Path) -> dict | None:
    """Of a calibrated rig; another has nothing but its noise, which the report says anyway."""
    from gonio.budget import budget_of, write_budget

    budget = budget_of(folder)
    return write_budget(folder, budget) if budget.common.calibrated else None


def _run_flow(folder: Path):
    """The density of the run's flow, None if it had none."""
    path = Path(folder) / "flow_density.npz"
    return gonio.load_brdf(path) if path.exists() else None


def make_figures(folder: Path, which: str, truth: str | None = None) -> list[str]:
    """The thesis's figures on this run's data, in RUN/figures: all of them ("thesis") or one, by its number.

    Lines that say what was made. Raises Missing for one that this run does not allow, ConfigError for no such figure.
    """
    from gonio.render.thesis.page import FIGURES, make_all, make_figure

    if which != "thesis" and which not in FIGURES:
        raise ConfigError(f"--figures {which}: not `thesis` or one of {', '.join(FIGURES)}")
    subject = _subject(folder, truth)
    out = Path(folder) / "figures"
    out.mkdir(exist_ok=True)
    if which == "thesis":
        return make_all(subject, out)
    return [f"figure {which}  {make_figure(which, subject, out)}"]


def _subject(folder: Path, truth: str | None):
    from gonio.render.thesis.subject import Subject

    material = read_config(folder).material
    shown = find(truth) if truth else own_truth(folder)
    path = Path(folder) / "flow.npz"
    flow = gonio.load_brdf(path) if path.exists() else None
    with Store.open(folder, write=False) as store:
        samples = load_samples(store)
    return Subject(
        name=material.name,
        proposal=material.sampler.proposal,
        channels=material.channels,
        samples=samples,
        ours=gonio.load_brdf(folder),
        truth=None if shown is None else gonio.load_brdf(shown.path),
        density=_run_flow(folder) if flow is None else getattr(flow, "density", None),
        flow=flow,
        seed=material.seed,
    )


def render_band(folder: Path, size: int, spp: int) -> list[str]:
    """band.png in the run: the lower and upper ends of the interval of 95 % beside the BRDF. Raises ConfigError for a
    model without intervals."""
    from gonio.render.band import render_band

    brdf: Any = gonio.load_brdf(folder)
    if not hasattr(brdf, "interval"):
        raise ConfigError(f"{folder}: its BRDF has no intervals; `gonio reconstruct --model auto` makes one that has")
    return render_band(brdf, Path(folder), size, spp)


def render_run(folder: Path, truth: str | None, size: int, spp: int) -> list[str]:
    """render.png and render.json in the run: truth, ours, difference in Mitsuba 3; the lines that say so."""
    from gonio.render.beside import render_beside

    found = find(truth) if truth else own_truth(folder)
    ours = gonio.load_brdf(folder)
    if found is None:
        return render_beside(ours, None, None, Path(folder), size, spp)
    table = Path(found.path) if str(found.path).endswith(".bsdf") else None
    return render_beside(ours, gonio.load_brdf(found.path), table, Path(folder), size, spp)
