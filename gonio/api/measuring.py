"""A run from a script: acquire, resume, and the sampler alone for a loop of one's own."""

import contextlib
import os
from collections.abc import Callable, Iterator
from pathlib import Path

from gonio.acquire import Interrupted, Progress
from gonio.api.material import Material
from gonio.api.rig import OpenRig, Truth, as_brdf, open_rig
from gonio.api.run import Run, open_run
from gonio.brdf import Brdf
from gonio.config import ConfigError
from gonio.config import Material as MaterialConfig
from gonio.config.rig import RigConfig
from gonio.mcmc import Sampler
from gonio.run import start as runs

Callback = Callable[[Progress], object]


def acquire(
    material: MaterialConfig | str | os.PathLike[str],
    rig: OpenRig | RigConfig | str | os.PathLike[str] = "sim",
    out: str | os.PathLike[str] | None = None,
    callback: Callback | None = None,
) -> Run:
    """Measure a material and store every reading; the run.

    material: a `gonio.Material`, or the name or file of one. rig: of `gonio.open_rig`, which stays open, or its name or
    file. out: the run's folder [default: runs/<material>/<stamp>]. callback(progress) is called after each stored
    measurement, or tour on an ideal rig: `progress.measured`, `.budget`, `.rig_s`, `.acceptance`, `.eta_s()`,
    `.seen` (directions, f and sigma just measured); where it returns False the run ends there and can be resumed.
    Ctrl-C stops the motors at once; what was measured is stored. The BRDF is made by `Run.brdf`.

    Raises ConfigError and the other errors of a bad config, StoreError, DeviceFault, SafetyStop, CalibrationMissing.

    Examples:
        >>> import gonio, tempfile
        >>> few = gonio.Material("analytic_gloss", budget={"measurements": 40})
        >>> run = gonio.acquire(few, "ideal", out=tempfile.mkdtemp() + "/run")
        >>> len(run.samples), run.ended
        (40, 'budget of 40 measurements')
    """
    if not isinstance(material, MaterialConfig):
        material = Material(material)
    with _opened(rig, None) as opened:
        run = runs.start(material, opened.config, out, opened.truth)
        return _drive(run, opened, callback)


def resume(
    run: Run | str | os.PathLike[str],
    rig: OpenRig | None = None,
    callback: Callback | None = None,
    *,
    truth: Truth | None = None,
    measurements: int | None = None,
) -> Run:
    """Go on with an interrupted run, as the very chain it would have been; or, with more `measurements`, a longer one.

    rig: None = the run's own, opened for it. truth: of a run that shows a function, that function again. Otherwise as
    `acquire`.
    """
    folder = run.folder if isinstance(run, Run) else Path(run)
    config = open_run(folder).config.rig
    if rig is not None and rig.config != config:
        raise ConfigError(f"{folder}: was measured by another rig, or by {config.name} as its YAML was then; open that")
    more = () if measurements is None else (f"budget.measurements={measurements}",)
    with _opened(rig or config, truth) as opened:
        return _drive(runs.resume(folder, more, truth=opened.truth), opened, callback)


def make_sampler(material: MaterialConfig, rig: OpenRig) -> Sampler:
    """The chain alone, for a loop of one's own: `ask()` says what to measure, `tell(ids, f, sigma)` hears what it was.

    Examples:
        >>> import gonio
        >>> material = gonio.Material(name="mine", channels=["L"])
        >>> with gonio.open_rig("ideal", truth=lambda wi, wo: 0.3 + 0 * wi[:, 0]) as rig:
        ...     sampler = gonio.make_sampler(material, rig)
        ...     batch = sampler.ask()
        ...     for seen in rig.visit(batch.wi, batch.wo, batch.ids):
        ...         sampler.tell(seen.ids, seen.f, seen.sigma)
        >>> bool(sampler.ask().ids.min() == len(batch.ids))
        True
    """
    from gonio.mcmc import make_sampler as make
    from gonio.reconstruct.samples import Samples
    from gonio.run.stop_rules import running_fit

    anisotropic = material.symmetry == "anisotropic"

    def fit_surrogate(wi, wo, f, sigma=None) -> Brdf | None:
        return running_fit(Samples.of(wi, wo, f, sigma), anisotropic)

    return make(material, rig.reachable, fit_surrogate)


def _drive(run: runs.Run, rig: OpenRig, callback: Callback | None) -> Run:
    ended = False

    def watch(progress: Progress) -> None:
        nonlocal ended
        if callback is not None and _said_no(callback(progress)):
            ended = True

    try:
        with run.nothing_left_behind():
            opened = rig.for_run(run.config.material, run.truth)
        run(watch=watch, interrupted=lambda: ended, rig=opened)
    except Interrupted:
        pass  # as the callback wanted
    finally:
        run.close()
    return open_run(run.store.folder)


@contextlib.contextmanager
def _opened(rig: OpenRig | RigConfig | str | os.PathLike[str], truth: Truth | None) -> Iterator[OpenRig]:
    if isinstance(rig, OpenRig):
        if truth is not None:
            rig.truth = as_brdf(truth)
        yield rig
        return
    with open_rig(rig, truth) as opened:
        yield opened


def _said_no(answer: object) -> bool:
    """Whether a callback wants an end: False, NumPy's too; None and whatever else go on."""
    import numpy as np

    return isinstance(answer, bool | np.bool_) and not answer
