"""What a config would do, without doing it: `gonio check`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gonio.config.instrument import TextSection
from gonio.config.material import Material
from gonio.config.rig import RigConfig
from gonio.geometry import Array
from gonio.rig.build import park_pose
from gonio.rig.motion.plan import Planner
from gonio.run.prepare import prepare

PAIRS = 20_000
TOUR = 512


@dataclass(frozen=True)
class Plan:
    """What a run would do. `figures` are what `gonio check --json` prints (docs/json.md), `text` says them in words."""

    figures: dict[str, Any]
    text: str


def plan_of(material: Material, rig: RigConfig, out: Path | None = None) -> Plan:
    """The resolved plan: sample, chain, reachable share of the domain, estimated rig time. Touches no hardware.

    Raises what `prepare` does: whatever `acquire` would refuse before it moves.
    """
    ready = prepare(material, rig, out)
    envelope = ready.envelope
    wi, wo = _random_pairs(np.random.default_rng(0), PAIRS)
    reachable = envelope.reachable(wi, wo)
    chosen = np.flatnonzero(reachable)[:TOUR]
    c, target = material.sampler, material.sampler.target
    seconds = hours = None
    if len(chosen):
        each = _seconds(envelope, rig, material, wi[chosen], wo[chosen])
        motion = each - rig.settle_s - rig.reading_s
        seconds = {"measurement": each, "motion": motion, "settle": rig.settle_s, "reading": rig.reading_s}
        if material.budget.measurements is not None:
            hours = each * material.budget.measurements / 3600
    figures = {
        "material": material.name,
        "symmetry": material.symmetry,
        "dimensions": 3 if material.symmetry == "isotropic" else 4,
        "channels": list(material.channels),
        "truth": None if ready.truth is None else {"name": material.truth, "origin": ready.origin},
        "sampler": {"chains": c.chains, "proposal": c.proposal, "seed": material.seed},
        "target": {
            "channels": target.channels,
            "power": target.power,
            "floor": target.floor,
            "scene": target.scene,
            "scene_floor": target.scene_floor,
        },
        "rig": {
            "name": rig.name,
            "depth": rig.depth,
            "kinematics": rig.kinematics.kind,
            "stay_out_deg": rig.stay_out_deg,
        },
        "detector": _detector(rig),
        "reachable": float(reachable.mean()),
        "seconds": seconds,
        "rig_hours": hours,
        "budget": {"measurements": material.budget.measurements, "rig_hours": material.budget.rig_hours},
        "stop": {
            "energy_error": material.stop.energy_error,
            "ess": material.stop.ess,
            "scene_error": material.stop.scene_error,
        },
        "reconstruct": material.reconstruct.model,
    }
    return Plan(figures, _text(figures))


def _text(p: dict[str, Any]) -> str:
    truth, sampler, target, rig, seconds = (p[k] for k in ("truth", "sampler", "target", "rig", "seconds"))
    sample = f"{p['material']}, {p['symmetry']}: {p['dimensions']} dimensions, {len(p['channels'])} channels"
    lines = [
        ("material", sample),
        ("truth", f"{truth['name']}, {truth['origin']}" if truth else "none: the rig is real"),
        ("chain", f"{sampler['chains']} x {sampler['proposal']}, seed {sampler['seed']}"),
        (
            "target",
            f"channels {target['channels']}, power {target['power']:g}, floor {target['floor']:.0%} of the draws",
        ),
        *([("picture", f"{target['scene']}, floor {target['scene_floor']:g}")] if target["scene"] else []),
        ("rig", f"{rig['name']} ({rig['depth']}), {rig['kinematics']}, stay-out {rig['stay_out_deg']:g} deg"),
        ("detector", p["detector"]),
        ("reachable", f"{p['reachable']:.1%} of all pairs of directions, each weighted by its cosine"),
    ]
    if seconds is not None:
        parts = f"motion {seconds['motion']:.2f}, settle {seconds['settle']:g}, reading {seconds['reading']:.2g}"
        lines.append(("a measurement", f"{seconds['measurement']:.2f} s: {parts}"))
    if (hours := p["rig_hours"]) is not None:
        n = p["budget"]["measurements"]
        lines.append(("rig time", f"about {hours:.1f} h for {n} measurements of cosine-distributed pairs"))
    if (most := p["budget"]["rig_hours"]) is not None:
        lines.append(("ends after", f"{most:g} rig hours at most"))
    if (error := p["stop"]["scene_error"]) is not None:
        lines.append(("ends when", f"the estimated error in the picture is below {error:g}"))
    if (error := p["stop"]["energy_error"]) is not None:
        lines.append(("ends when", f"the estimated energy error is below {error:g}"))
    lines.append(("then", f"reconstruct with {p['reconstruct']}"))
    return "\n".join(f"{k:14} {v}" for k, v in lines)


def _detector(rig: RigConfig) -> str:
    """What reads, and how."""
    c, p = rig.camera, rig.photodiode
    if rig.depth == "ideal":
        return "none: f as it is"
    if rig.detector == "camera":
        ladder = f"{len(c.exposure_s)} exposures from {c.exposure_s[0]:g} to {c.exposure_s[-1]:g} s"
        files = rig.calibration.camera or "as drawn", rig.calibration.frames or "learnt at the start"
        looks = f"camera, {len(c.channels)} channels, {ladder}, a disk of {c.region_mm:g} mm"
        return f"{looks}; optics {files[0]}, frames {files[1]}"
    if isinstance(rig.detector, TextSection):
        i, n = rig.detector.instrument, rig.detector.channels
        ranges = f"{len(i.ranges.full_scale) if i.ranges else 1} ranges"
        return f"{i.name} (text), {ranges}, unit {i.unit}, {n} channel{'s' if n > 1 else ''}, {rig.exposure_s:g} s"
    if rig.detector != "photodiode":
        return f"driver {rig.detector_kind}, {rig.exposure_s:g} s"
    average = f", averaged to {p.target_sigma:.2g}, {p.max_readings} readings at most" if p.target_sigma else ""
    return f"photodiode, {p.ranges} ranges of {p.bits} bits, {rig.exposure_s:g} s{average}"


def _seconds(envelope, rig: RigConfig, material: Material, wi: Array, wo: Array) -> float:
    """Mean rig seconds of a measurement over tours of such pairs, as the run would plan them."""
    planner = Planner(envelope, material.plan, material.symmetry == "isotropic")
    block = material.sampler.chains * (
        material.sampler.block if material.sampler.proposal in ("auto", "independence") else 1
    )
    pose, total = park_pose(rig), 0.0
    for begin in range(0, len(wi), block):
        part = slice(begin, begin + block)
        for tour in planner.tours(wi[part], wo[part], pose):
            total += float(tour.seconds.sum())
            pose = tour.poses[-1]
    return total / len(wi) + rig.settle_s + rig.reading_s


def _random_pairs(rng, n: int) -> tuple[Array, Array]:
    def cosine():
        r, phi = np.sqrt(rng.random(n)), 2 * np.pi * rng.random(n)
        return np.stack([r * np.cos(phi), r * np.sin(phi), np.sqrt(1 - r * r)], -1)

    return cosine(), cosine()
