"""What a config would do, without doing it: `gonio check`."""

import numpy as np

from gonio.config.material import Material
from gonio.config.rig import RigConfig
from gonio.geometry import Array
from gonio.rig.build import envelope_of, park_pose
from gonio.rig.plan import Planner

PAIRS = 20_000
TOUR = 512


def plan_text(material: Material, rig: RigConfig) -> str:
    """The resolved plan: sample, chain, reachable share of the domain, estimated rig time. Touches no hardware."""
    c, target = material.sampler, material.sampler.target
    isotropic = material.symmetry == "isotropic"
    envelope = envelope_of(rig)
    wi, wo = _random_pairs(np.random.default_rng(0), PAIRS)
    reachable = envelope.reachable(wi, wo)
    chosen = np.flatnonzero(reachable)[:TOUR]
    dimensions = 3 if isotropic else 4
    nothing = "none: the rig is real" if rig.depth == "real" else "missing, and this rig needs one"
    sample = f"{material.name}, {material.symmetry}: {dimensions} dimensions, {len(material.channels)} channels"
    lines = [
        ("material", sample),
        ("truth", material.truth or nothing),
        ("chain", f"{c.chains} x {c.proposal}, seed {material.seed}"),
        ("target", f"channels {target.channels}, power {target.power:g}, floor {target.floor:.0%} of the draws"),
        ("rig", f"{rig.name} ({rig.depth}), {rig.kinematics.kind}, stay-out {rig.stay_out_deg:g} deg"),
        ("reachable", f"{reachable.mean():.1%} of all pairs of directions, each weighted by its cosine"),
    ]
    if len(chosen):
        each = _seconds(envelope, rig, material, wi[chosen], wo[chosen])
        motion = each - rig.settle_s - rig.exposure_s
        parts = f"motion {motion:.2f}, settle {rig.settle_s:g}, exposure {rig.exposure_s:g}"
        lines.append(("a measurement", f"{each:.2f} s: {parts}"))
        if (n := material.budget.measurements) is not None:
            lines.append(
                ("rig time", f"about {each * n / 3600:.1f} h for {n} measurements of cosine-distributed pairs")
            )
    if material.budget.rig_hours is not None:
        lines.append(("ends after", f"{material.budget.rig_hours:g} rig hours at most"))
    if material.stop.energy_error is not None:
        lines.append(("ends when", f"the estimated energy error is below {material.stop.energy_error:g}"))
    lines.append(("then", f"reconstruct with {material.reconstruct.model}"))
    return "\n".join(f"{k:14} {v}" for k, v in lines)


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
    return total / len(wi) + rig.settle_s + rig.exposure_s


def _random_pairs(rng, n: int) -> tuple[Array, Array]:
    def cosine():
        r, phi = np.sqrt(rng.random(n)), 2 * np.pi * rng.random(n)
        return np.stack([r * np.cos(phi), r * np.sin(phi), np.sqrt(1 - r * r)], -1)

    return cosine(), cosine()
