"""A simulated rig with hidden errors, calibrated as the commands do it; and how right it has itself."""

import time
from pathlib import Path
from typing import Any

import numpy as np

from calibration.geometry.fit import apart, calibration_of, fit_geometry, random_poses
from calibration.geometry.session import Session as GeometrySession
from calibration.radiometry import Certificate
from calibration.radiometry import Session as RadiometrySession
from gonio.brdf.models.lambert import Lambert
from gonio.config.rig import RigConfig
from gonio.geometry import Array, from_angles
from gonio.rig.build import kinematics_of
from gonio.rig.calibration import RadiometryCalibration, save_calibration
from gonio.rig.devices import Reading
from gonio.rig.signal.radiometry import Radiometry
from gonio.run.open_rig import open_rig
from sim.mirror import Mirror
from sim.world import TrueRig

WEDGE = 15.0  # degrees
WHITE = np.array([0.31, 0.30, 0.29])  # the certificate's f at 45/0, 1/sr
POSES = 1000


def hidden(rig: RigConfig, seed: int) -> RigConfig:
    """The rig with the hidden errors of a seed."""
    return RigConfig.model_validate({**rig.model_dump(), "world": {"seed": seed}})


def calibrated(rig: RigConfig, seed: int, u: float, folder: Path) -> tuple[RigConfig, dict[str, Any]]:
    """The rig with its calibrations, and figures; their files go to the folder. u: of the reference, relative (k =
    1)."""
    true = TrueRig(rig, len(WHITE))
    began = []
    a = np.radians(WEDGE)
    geometry = GeometrySession(rig, (np.array([np.sin(a), 0.0, np.cos(a)]),))
    for number, mirror in enumerate((Mirror(), Mirror.on_wedge(WEDGE))):
        with _open(rig, mirror, seed) as opened:
            geometry.measure(opened, number, seed)
            began.append(opened.clock.now())
    geometry.confirm()
    clock = time.process_time()
    fit = fit_geometry(geometry.observations, geometry.parameters)
    solve_s = time.process_time() - clock
    path = save_calibration(calibration_of(fit, rig, True, geometry.held_out_rms), folder)
    rig = _with(rig, geometry=str(path))
    what = 1 + u * np.random.default_rng([seed, 77]).standard_normal()  # what the reference is beside its certificate
    session = RadiometrySession(Certificate.of_one(45.0, 0.0, WHITE, u))
    with _open(rig, Lambert(np.pi * WHITE * what), seed) as opened:
        session.measure_white(opened)
        began.append(opened.clock.now())
    with _open(rig, Lambert(0 * WHITE), seed) as opened:
        session.measure_trap(opened)
        began.append(opened.clock.now())
        found = session.result(opened)
    rig = _with(rig, radiometry=str(save_calibration(found, folder)))
    return rig, {
        "geometry": _directions(rig, true, geometry, fit),
        "radiometry": {
            "z": _z(rig, true, found),
            "linear": _linear(rig, true, found),
            "standard": _standard(rig, what, seed),
        },
        "rig_minutes": sum(began) / 60,
        "solve_s": solve_s,
    }


def _directions(rig: RigConfig, true: TrueRig, session: GeometrySession, fit) -> dict[str, Any]:
    perfect = true.geometry(rig)
    truth = kinematics_of(rig, perfect)
    poses = random_poses(rig, POSES, np.random.default_rng(5))
    before, after = (np.degrees(apart(truth, k, poses)) for k in (kinematics_of(rig), fit.kinematics))
    known = [not n.startswith("mirror") for n in session.parameters.names]
    z = ((fit.p - session.parameters.inverse_of(perfect)) / fit.sigma)[known]
    rms = lambda x: float(np.sqrt(np.mean(x**2)))
    return {
        "before_rms": rms(before),
        "before_worst": float(before.max()),
        "rms": rms(after),
        "worst": float(after.max()),
        "said": float(np.degrees(fit.directions_sigma)),
        "held_out": float(np.degrees(session.held_out_rms)),
        "z": z.tolist(),
    }


def _z(rig: RigConfig, true: TrueRig, found: RadiometryCalibration) -> list[float]:
    """Each calibrated parameter beside the truth, in its own sigmas."""
    h, per = true.hidden, rig.exposure_s
    gain = np.pi / per * h.gain * true.through
    parts = [
        (np.array(found.gain) - gain) / np.array(found.gain_sigma),
        [(found.linearity - h.nonlinearity) / found.linearity_sigma],
        ((np.array(found.range_ratios) - h.ratios) / np.maximum(found.range_ratios_sigma, 1e-300))[1:],
        (np.array(found.stray) - h.gain * h.stray / per) / np.array(found.stray_sigma),
        [(found.drift_per_h - h.drift * 3600) / found.drift_per_h_sigma],
    ]
    return np.concatenate(parts).tolist()


def _linear(rig: RigConfig, true: TrueRig, found: RadiometryCalibration) -> float:
    """The largest relative error of a corrected signal over four decades, beside its mean."""
    p = rig.photodiode
    known = Radiometry(np.ones(1), np.zeros(1), linearity=found.linearity, ratios=np.array(found.range_ratios))
    full = p.full_scale * p.range_factor ** np.arange(p.ranges)
    signals = np.geomspace(0.5 * full[-1] / 1e4, 0.5 * full[-1], 200)
    ratios = []
    for s in signals:
        k = np.array([np.searchsorted(full, s)])
        shown = true.converted(np.array([s]), k, full[k])
        raw = {"full_scale": full[k].tolist(), "range": k.tolist(), "exposure_s": rig.exposure_s}
        ratios.append(float(known.signal(Reading(shown, 0 * shown, False, raw))[0][0] / s))
    return float(np.abs(np.array(ratios) / np.mean(ratios) - 1).max())


def _standard(rig: RigConfig, what: float, seed: int) -> float:
    """Rms relative error of the reference, as certified, at angles up to 60 degrees that calibration did not use."""
    rng = np.random.default_rng([seed, 78])
    draw = lambda n: from_angles(np.radians(rng.uniform(0, 60, n)), rng.uniform(-np.pi, np.pi, n))
    wi, wo = draw(24), draw(24)
    with _open(rig, Lambert(np.pi * WHITE * what), seed) as opened:
        order = np.repeat(np.arange(24), 8)
        f = np.full((len(order), len(WHITE)), np.nan)
        for seen in opened.visit(wi[order], wo[order], np.arange(len(order))):
            f[seen.ids] = seen.f
    mean: Array = f.reshape(24, 8, -1).mean(1)
    return float(np.sqrt(np.nanmean((mean / WHITE - 1) ** 2)))


def _with(rig: RigConfig, **files: str) -> RigConfig:
    return rig.model_copy(update={"calibration": rig.calibration.model_copy(update=files)})


class _open:
    """A simulated rig with something on it."""

    def __init__(self, rig: RigConfig, truth, seed: int):
        self.rig: Any = open_rig(rig, truth, seed)

    def __enter__(self):
        return self.rig

    def __exit__(self, *exc) -> None:
        self.rig.close()
