"""The first YAML of a rig and of a material, with comments: what `gonio init` writes. Each loads as it is written."""

import json
from collections.abc import Mapping, Sequence

from gonio.config.rig import GANTRY_AXES, GIMBAL_AXES

NOT_FOUND = "/dev/serial/by-id/NOT-FOUND-YET"
NO_CAMERA = "/dev/v4l/by-id/NOT-FOUND-YET"
TRAVEL = {
    "light": (-85, 85), "detector": (-85, 85), "turntable": (-180, 179.95), "azimuth": (-180, 179.95),
    "yaw": (-180, 179.95), "tilt": (-90, 90), "roll": (-180, 179.95),
}  # fmt: skip
ARM = {"gimbal": (9, 175)}  # the swing arm stays on one side of the light


def axes_of(kinematics: str) -> tuple[str, ...]:
    return GANTRY_AXES if kinematics == "gantry" else GIMBAL_AXES


def rig_yaml(
    name: str,
    *,
    kinematics: str = "gantry",
    detector: str = "photodiode",
    stage: str | None = None,
    baud: int = 1_000_000,
    model: str | None = None,
    ids: Mapping[str, int] | None = None,
    photodiode: str | None = None,
    light: str | None = None,
    camera: str | None = None,
    found: Sequence[str] = (),
) -> str:
    """A real rig. Ports that are None are left to be filled in; found: lines that say what answered where."""
    names = axes_of(kinematics)
    ids = ids or {axis: k for k, axis in enumerate(names, 1)}
    text = [
        f"# Rig {name}, begun by `gonio init rig`. Angles in degrees. `gonio doctor --rig {name}.yaml` checks it.",
        *(f"# {line}" for line in found),
        f"name: {name}",
        "depth: real",
        f"kinematics: {{kind: {kinematics}}}   # gantry, gimbal; chain for any other rig of joints",
        "axes:                         # the limits that your rig really has: nothing is ever driven beyond them",
        *(_axis(axis, kinematics) for axis in names),
        f"park_deg: {_park(kinematics)}   # where the arms rest",
        "settle_s: 0.15                # after each move, before a reading",
        "exposure_s: 0.020",
        "stay_out_deg: 8               # around the light, where one arm shades the other",
        "acceptance: {light_half_angle_deg: 0.5, detector_half_angle_deg: 0.5}   # cones as the sample sees them",
        f"detector: {detector}",
        "light: {warm_up_s: 60}        # waited for once after the lamp is switched on",
        "devices:",
        "  stage:                      # servos; ids by axis: `gonio jog` shows which is which",
        f"    port: {_text(stage or NOT_FOUND)}{_todo(stage)}",
        f"    baud: {baud}",
        f"    model: {model or 'XM430-W350'}",
        f"    ids: {{{', '.join(f'{axis}: {k}' for axis, k in ids.items())}}}",
        "    after_fault: hold         # or release: the arms go limp",
    ]
    if detector == "camera":
        text += [f"  camera: {{device: {_text(camera or NO_CAMERA)}, format: YUYV}}{_todo(camera)}"]
    else:
        text += [f"  photodiode: {{port: {_text(photodiode or NOT_FOUND)}, baud: 115200}}{_todo(photodiode)}"]
    if light is None:
        text += [f"  # light: {{port: {NOT_FOUND}, baud: 115200}}   # without: switch the lamp yourself"]
    else:
        text += [f"  light: {{port: {_text(light)}, baud: 115200}}"]
    text += [f"# `gonio calibrate all --rig {name}.yaml --f 0.312` writes the files to be named here:"]
    text += ["calibration: {geometry: null, radiometry: null, max_age_days: 90}"]
    return "\n".join(text) + "\n"


def material_yaml(
    name: str,
    *,
    symmetry: str = "isotropic",
    channels: Sequence[str] = ("R", "G", "B"),
    truth: str | None = None,
    measurements: int | None = 2000,
    rig_hours: float | None = None,
    energy_error: float | None = None,
    sample_id: str | None = None,
    operator: str | None = None,
    notes: str | None = None,
) -> str:
    """A sample and the run to make of it."""
    about = (
        _key("sample_id", sample_id, "what the label says")
        + _key("operator", operator, "who measures")
        + _key("notes", notes, "how it was prepared")
    )
    budget = [f"measurements: {measurements}"] * (measurements is not None)
    budget += [f"rig_hours: {rig_hours:g}"] if rig_hours is not None else []
    error = "0.03" if energy_error is None else f"{energy_error:g}"
    text = [
        f"# Sample {name}, begun by `gonio init material`. `gonio check {name}.yaml --rig R`: what the run would do.",
        f"name: {name}",
        *about,
        f"symmetry: {symmetry}          # or anisotropic: brushed, woven; a mark on the sample shows its 0 degrees",
        f"channels: [{', '.join(map(_text, channels))}]   # as many as the detector has",
        _key("truth", truth, "what a simulated rig shows; a real one refuses this key", example="chm_orange")[0],
        "sampler: {proposal: auto}     # where to look: docs/sampling.md",
        f"budget: {{{', '.join(budget)}}}          # measurements, rig_hours: whichever is spent first",
        f"{'# ' if energy_error is None else ''}stop: {{energy_error: {error}}}   # estimated; needs no truth",
        "reconstruct: {model: auto}    # docs/reconstruction.md",
        "seed: 0",
    ]
    return "\n".join(text) + "\n"


def _axis(axis: str, kinematics: str) -> str:
    low, high = ARM.get(kinematics, TRAVEL[axis]) if axis == "detector" else TRAVEL[axis]
    return f"  {axis + ':':10} {{lower_deg: {low}, upper_deg: {high}, velocity_deg_s: 60, acceleration_deg_s2: 120}}"


def _park(kinematics: str) -> str:
    return "{light: -45, detector: 45}" if kinematics == "gantry" else "{detector: 45}"


def _todo(given: str | None) -> str:
    return "" if given else "   # not found; give its name there"


def _key(key: str, value: str | None, what: str, example: str = "...") -> list[str]:
    return [f"# {key}: {example}   # {what}" if value is None else f"{key}: {_text(value)}   # {what}"]


def _text(value: str) -> str:
    """A YAML scalar that cannot be taken for anything but this text."""
    plain = value.replace("_", "").replace("-", "").replace("/", "").replace(".", "").isalnum() and value.isascii()
    safe = (plain and value[0] in "/") or (plain and value[0].isalpha() and value.lower() not in _WORDS)
    return value if safe else json.dumps(value, ensure_ascii=False)


_WORDS = {"null", "true", "false", "yes", "no", "on", "off", "y", "n"}
