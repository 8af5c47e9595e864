"""From configs to a finished run folder: open what they name, acquire, make the BRDF and the report."""

import contextlib
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gonio
from gonio.acquire import Interrupted, Progress, acquire
from gonio.brdf import Brdf
from gonio.config import ConfigError, Material
from gonio.config.rig import RigConfig
from gonio.config.scan import Scan
from gonio.mcmc import make_sampler
from gonio.mcmc.listed import Listed
from gonio.rig.errors import RigError
from gonio.rig.signal.watch import LostSight
from gonio.run.open_rig import open_rig
from gonio.run.prepare import prepare
from gonio.run.provenance import provenance
from gonio.run.record.config import RunConfig, dump, read_config, write_config
from gonio.run.record.store import Store
from gonio.run.scan import SCAN, scan_for, scan_of, vectors
from gonio.run.truth import find_truth, own_truth, refuse_another_scene


@dataclass
class Run:
    """An acquisition about to start or to go on: call it to drive the rig."""

    config: RunConfig
    store: Store
    truth: Brdf | None

    def __call__(
        self,
        *,
        watch: Callable[[Progress], None] = lambda p: None,
        interrupted: Callable[[], bool] = lambda: False,
        rig=None,
    ) -> str:
        """Acquire; the reason it ended. The rig is opened here and closed whatever happens, unless one is given."""
        from gonio.run.stop_rules import GoodEnough

        material = self.config.material
        store = self.store
        given = rig is not None
        if not given:
            with self.nothing_left_behind():
                rig = open_rig(
                    self.config.rig,
                    self.truth,
                    material.seed,
                    plan=material.plan,
                    isotropic=material.symmetry == "isotropic",
                )
        good_enough = GoodEnough(material, store)
        try:
            if state := store.kept():
                rig.restore(state)
            sampler = self._sampler(rig, good_enough)
            rig.surrogate = good_enough.expected
            reason = acquire(
                sampler, rig, store, material, watch=watch, interrupted=interrupted, good_enough=good_enough
            )
            rig.look()  # what was measured since the last look is confirmed now, or made again
            note_flow(sampler.plan, store)
            store.put("ended", reason)
            store.event("ended", reason)
            return reason
        except Interrupted:
            note_flow(sampler.plan, store)
            store.event("interrupted", "by the operator")
            raise
        except RigError as e:
            if isinstance(e, LostSight):
                store.suspect(e.suspect, str(e))
            store.event("fault", str(e))
            raise
        except BaseException as e:  # told to stop at once, a full disk, a bug: the motors first
            rig.stop()
            if isinstance(e, KeyboardInterrupt):
                store.event("stopped", "at once, by the operator")
            raise
        finally:
            rig.surrogate = None
            try:
                store.commit()
            finally:
                if not given:
                    rig.close()

    def _sampler(self, rig, good_enough) -> Any:
        """A list given by hand where the run has one, else the chain."""
        if (scan := scan_of(self.store)) is not None:
            return Listed(*vectors(scan))
        material = self.config.material
        return make_sampler(material, rig.reachable, good_enough.fit_surrogate, budgets(self.store, material))

    @contextlib.contextmanager
    def nothing_left_behind(self) -> Iterator[None]:
        """Around the opening of the rig: a new run that cannot have one leaves no folder."""
        try:
            yield
        except BaseException:
            self.store.discard()
            raise

    def close(self) -> None:
        self.store.close()


def start(
    material: Material,
    rig: RigConfig,
    out: str | os.PathLike[str] | None = None,
    truth: Brdf | None = None,
    scan: Scan | None = None,
) -> Run:
    """A new run folder, nothing measured yet. out = None: runs/<material>/<UTC stamp>-<short id>.

    truth: what a simulated rig shows where the material names nothing; not kept in the run. scan: a list of directions
    to measure in place of the chain's.

    Raises what `prepare` does, before there is a folder; StoreError where it cannot be made.
    """
    ready = prepare(material, rig, None if out is None else Path(out), truth)
    about: dict[str, Any] = {}
    if scan is not None:
        scan, material = scan_for(scan, material, rig, ready.envelope)
        about = {SCAN: scan.model_dump(mode="json")}
    config = RunConfig(material=material, rig=rig)
    store = Store.create(ready.folder, dump(config), provenance(material, rig, ready.origin) | about, **_care(rig))
    shown = ready.origin or "what lies on the rig"
    store.event("started", f"gonio {gonio.__version__}, rig {rig.name} ({rig.depth}), truth {shown}")
    return Run(config, store, ready.truth)


def resume(
    folder: str | os.PathLike[str],
    overrides: tuple[str, ...] = (),
    *,
    allow_stale: bool = False,
    truth: Brdf | None = None,
) -> Run:
    """An interrupted run, ready to go on; overrides may change its budget and stop rules.

    allow_stale: with calibrations that have expired since; the run says so from now on. truth: as in `start`.
    """
    stale = ("rig.calibration.allow_stale=true",) * allow_stale
    config = read_config(folder, (*(f"material.{o}" for o in overrides), *stale))
    if config.imported is not None:
        raise ConfigError(
            f"{folder}: imported from {config.imported.files[0]}, no rig can go on with it; import a larger file"
        )
    allowed = ("budget.", "stop.", "reconstruct.")
    for o in overrides:
        if not o.startswith(allowed):
            raise ConfigError(
                f"--set {o}: a run keeps what its chain was started with; only budget, stop and reconstruct may change"
            )
    _refuse_less(folder, config.material)
    own_truth(folder)
    refuse_another_scene(folder)
    try:
        shown, origin = find_truth(config.material, config.rig, truth)
    except ConfigError:
        if truth is None and config.material.truth is None and config.rig.depth != "real":
            says = "shows a function that it does not keep; `gonio.resume(RUN, truth=f)` goes on"
            raise ConfigError(f"{folder}: {says}") from None
        raise
    if shown is not None and shown.channels != len(config.material.channels):
        raise ConfigError(f"truth: has {shown.channels} channels, the run in {folder} {len(config.material.channels)}")
    store = Store.open(folder, write=True, **_care(config.rig))
    if overrides or stale:
        write_config(folder, config)
    if stale:
        store.event("stale", "calibrations allowed to be")
    store.event("resumed", f"gonio {gonio.__version__}, truth {origin or 'what lies on the rig'}")
    return Run(config, store, shown)


def _refuse_less(folder: str | os.PathLike[str], material: Material) -> None:
    """A budget that is spent already would only be one more at which blocks end: the chain would be another one.

    Raises ConfigError.
    """
    with Store.open(folder, write=False) as store:
        measured, known = len(store.measured().id), store.get("budgets", [])
    now = material.budget.measurements
    if now is not None and now < measured and now not in known:
        raise ConfigError(f"budget.measurements: {now}, but {measured} are measured; `gonio report {folder}`, or more")


def budgets(store: Store, material: Material) -> tuple[int, ...]:
    """Every budget of measurements the run has had, the present one noted too: blocks end at them, so that a run whose
    budget was raised is, up to the old one, the run it was."""
    known = store.get("budgets", [])
    if (now := material.budget.measurements) is not None and now not in known:
        known = sorted([*known, now])
        store.put("budgets", known)
    return tuple(known)


def note_flow(plan, store: Store) -> None:
    """What a plan with a flow decided goes to the record, each election once; its density to flow_density.npz.

    Not after a fault: a resumed run holds the same elections again, and nothing may stand before what went wrong.
    """
    audit, density = getattr(plan, "audit", None), getattr(plan, "density", None)
    if audit is None:
        return
    known = sum(kind == "flow" for _, kind, _ in store.events())
    for entry in audit[known:]:  # a resumed run holds the same elections again
        store.event("flow", ", ".join(f"{k} {v:.4g}" if isinstance(v, float) else f"{k} {v}" for k, v in entry.items()))
    if density is not None:
        from gonio.load import save_brdf

        save_brdf(density, store.folder / "flow_density.npz")


def _care(rig: RigConfig) -> dict[str, Any]:
    """How a run is kept: real readings cannot be had again, simulated ones can, and an ideal rig's cost nothing."""
    return {"commit_interval": 0.05 if rig.depth == "ideal" else 0.0, "power_safe": rig.depth == "real"}
