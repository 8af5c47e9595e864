"""Whole runs of every kind, each drawn from its number: material, config, noise, hidden errors and faults.

A run may end well, be refused in one line, or end with a fault of a device that names it. It may not give a number that
is none, raise anything else, or go on for ever.
"""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from gonio.bench.harness import Row
from gonio.brdf import Brdf
from gonio.brdf.models.abc import Abc
from gonio.brdf.models.lambert import Lambert
from gonio.brdf.models.microfacet import Beckmann, Ggx
from gonio.brdf.models.mixture import Mixture
from gonio.brdf.models.student import Student
from gonio.config import Material, load_config
from gonio.config.find import find_config
from gonio.config.rig import RigConfig
from gonio.geometry import from_angles
from gonio.load import load_brdf, save_brdf
from gonio.reconstruct import MODELS

GOOD = ("ok", "refused", "fault")
LONGEST_S = 900  # of one run: a machine ten times slower than this one needs no more
SLOW_MODELS = ("flow", "flow_hd", "auto_flow", "thesis")


def cell(c: dict[str, Any]) -> list[Row]:
    rng = np.random.default_rng([2024, c["run"]])
    with TemporaryDirectory() as scratch:
        folder = Path(scratch)
        truth, words = material_of(rng)
        save_brdf(truth, folder / "truth.npz")
        material = config_of(rng, truth, str(folder / "truth.npz"))
        rig = rig_of(rng)
        sampler = f"{material.sampler.proposal} x {material.sampler.chains}"
        words += f", {rig.name}, {sampler}, N = {material.budget.measurements}, {material.reconstruct.model}"
        row: Row = {"what": words}
        try:
            with _at_most(LONGEST_S):
                return [row | _run(material, rig, folder / "run")]
        except TimeoutError:
            return [row | {"end": "hang", "why": f"more than {LONGEST_S} s"}]
        except Exception as e:
            code = getattr(e, "exit_code", None)
            one_line = "\n" not in str(e) and str(e)
            if code in (2, 5) and one_line:
                return [row | {"end": "refused", "why": str(e)}]
            if code in (3, 4) and one_line:
                return [row | {"end": "fault", "why": str(e)}]
            return [row | {"end": "crash", "why": f"{type(e).__name__}: {e}".replace("\n", " ")}]


def _run(material: Material, rig: RigConfig, folder: Path) -> Row:
    from gonio.run.products import make_brdf
    from gonio.run.start import start

    run = start(material, rig, folder)
    try:
        run()
        stored = run.store.measured()
        taken = len(stored.id)
    finally:
        run.close()
    make_brdf(folder)
    brdf: Any = load_brdf(folder)
    wi, wo = _pairs()
    values = {"f": brdf.eval(wi, wo), "pdf": brdf.pdf(wi, wo)}
    if hasattr(brdf, "interval"):
        values |= {
            "std": brdf.std(wi, wo),
            "low": brdf.interval(wi, wo, 0.95)[0],
            "high": brdf.interval(wi, wo, 0.95)[1],
        }
        values["estimate"] = np.array(brdf.energy_error_estimate)
    for name, v in values.items():
        if not np.isfinite(v).all() or v.min() < 0:
            return {"end": "NaN", "why": f"{name}: {v[~np.isfinite(v) | (v < 0)][:1]}", "measured": taken}
    return {"end": "ok", "measured": taken}


def material_of(rng: np.random.Generator) -> tuple[Brdf, str]:
    """A material of lobes of any width, from pitch black to far brighter than light allows; a channel may be 0."""
    channels = int(rng.choice([1, 3, 3, 3, 8]))
    alpha = float(10 ** rng.uniform(-3.5, 0))
    colour = rng.random(channels) * 10.0 ** rng.choice([0, 0, 0, 0, -6, -150, 4])
    if rng.random() < 0.15:
        colour[rng.integers(channels)] = 0.0
    kind = rng.integers(5)
    lobe: Brdf
    if kind == 0:
        lobe = Ggx(
            alpha, float(alpha * 10 ** rng.uniform(-0.7, 0.7)) if rng.random() < 0.3 else None, 0.04, weight=colour
        )
    elif kind == 1:
        lobe = Beckmann(alpha, None, 0.5, weight=colour)
    elif kind == 2:
        lobe = Student(alpha, None, 0.2, gamma=float(rng.uniform(1.6, 5)), weight=colour)
    elif kind == 3:
        lobe = Abc(0.2 * colour, colour, float(2 / alpha**2), float(rng.uniform(0.6, 3)))
    else:
        return Lambert(np.minimum(colour, 1e4)), f"lambert {colour.max():.2g}"
    truth = Mixture([Lambert(0.3 * colour), lobe]) if rng.random() < 0.7 else lobe
    return truth, f"{type(lobe).__name__} {alpha:.2g} x {colour.max():.2g}, {channels} channels"


def config_of(rng: np.random.Generator, truth: Brdf, path: str) -> Material:
    proposal = str(
        rng.choice(["auto", "auto", "auto", "independence", "pss_simple", "pss_vndf", "vmf_io", "vmf_hd", "delayed"])
    )
    sampler: dict[str, Any] = {"proposal": proposal, "chains": int(rng.choice([1, 1, 4, 32]))}
    if proposal == "auto":
        sampler["target"] = {"kind": str(rng.choice(["unknown", "unknown", "energy"]))}
    quick = [m for m in MODELS if m not in SLOW_MODELS]
    model = "auto" if rng.random() < 0.6 else str(rng.choice(quick))
    return Material.model_validate(
        {
            "name": "x",
            "truth": path,
            "channels": truth.channels,
            "symmetry": str(rng.choice(["isotropic", "isotropic", "anisotropic"])),
            "seed": int(rng.integers(2**31)),
            "sampler": sampler,
            "budget": {"measurements": int(np.exp(rng.uniform(np.log(5), np.log(400))))},
            "reconstruct": {"model": model},
            "plan": {"reciprocity": bool(rng.random() < 0.3), "reference_every": int(rng.choice([0, 0, 50]))},
        }
    )


def rig_of(rng: np.random.Generator) -> RigConfig:
    name = str(rng.choice(["ideal", "sim", "sim", "uncalibrated", "camera"], p=[0.2, 0.3, 0.2, 0.2, 0.1]))
    rig = load_config(find_config(name, "rigs"), RigConfig)
    more: dict[str, Any] = {}
    if rig.world is not None:
        more["world"] = {"seed": int(rng.integers(10**6))}
    if name != "ideal" and rng.random() < 0.5:
        share = float(10 ** rng.uniform(-4, -1))
        more["faults"] = {
            str(rng.choice(["stuck_axis", "silent_detector", "spike"] if name != "camera" else ["stuck_axis"])): share
        }
        if rng.random() < 0.3:
            more["faults"]["droop_deg"] = float(rng.uniform(0, 1))
    return RigConfig.model_validate(rig.model_dump(exclude_unset=True) | more)


def _pairs():
    rng = np.random.default_rng(3)
    theta = np.pi / 2 * rng.random((2, 400))
    theta[:, :8] = np.pi / 2 - np.geomspace(1e-9, 1e-2, 8)
    theta[0, 8:40] = theta[1, 8:40]
    phi = 2 * np.pi * rng.random((2, 400))
    phi[0, 8:40] = phi[1, 8:40] + np.pi
    return tuple(from_angles(t, p) for t, p in zip(theta, phi))


@contextmanager
def _at_most(seconds: int) -> Iterator[None]:
    """Raises TimeoutError in here after so many seconds; where signals cannot be had, it waits."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def ring(*_):
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, ring)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
