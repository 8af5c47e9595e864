"""What `gonio doctor` checks of a simulated rig: the same things, in the same order, as of a real one."""

import numpy as np

from gonio.config.rig import RigConfig
from gonio.daemon.rig_owner import RigOwner
from gonio.geometry import from_angles


def checkup(config: RigConfig) -> list[str]:
    """Lines `ok` or `FAIL`, what was checked, what was found. Raises DeviceFault, CalibrationMissing."""
    lines = [f"rig         {config.name}, depth {config.depth}: simulated, no hardware is touched"]
    for name in config.axis_names:
        a = config.axes[name]
        lines.append(f"ok   axis   {name}: {a.lower_deg:g} to {a.upper_deg:g} degrees, {a.velocity_deg_s:g} degrees/s")
    with RigOwner(config) as owner:
        rig = owner.as_is()
        wi, wo = from_angles(np.radians([45.0]), 0.0), from_angles(np.array([0.0]), np.pi)
        lines.append(_line(bool(rig.reachable(wi, wo)[0]), "reach", "the pair 45/0 degrees"))
        if config.depth == "ideal":
            return lines
        lines.append(_line(rig.stage.homed, "homed", "every axis" if rig.stage.homed else "no: run `gonio home`"))
        rig.light.off()
        dark = rig.detector.read(config.exposure_s)
        rig.drive(wi, wo)
        rig.light.on()
        lit = rig.detector.read(config.exposure_s)
        rig.light.off()
        lines.append(_line(not dark.saturated, "dark", f"signal {dark.value.max():.3g}"))
        clear = bool((lit.value > dark.value + 10 * dark.sigma).all())
        lines.append(_line(clear, "light", f"signal {lit.value.max():.3g} from a white diffuser at 45/0 degrees"))
        if config.detector == "camera":
            from drivers.doctor_camera import examine

            lines += examine(config, rig.detector.camera.source, rig.light)
        rig.park()
        lines.append("ok   parked light off")
    return lines


def _line(ok: bool, what: str, text: str) -> str:
    return f"{'ok  ' if ok else 'FAIL'} {what:6} {text}"
