"""The doctor's findings on a camera: what it is and offers, whether it obeys, what it sees in the dark and when lit."""

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from drivers.camera import Camera, FrameSource
from drivers.hdr import NEAR_SATURATION
from gonio.config.devices import CameraDeviceConfig
from gonio.config.rig import RigConfig
from gonio.geometry import Array
from gonio.rig.devices import Light
from gonio.rig.errors import DeviceFault

STRAY = 0.1  # of full scale: a darkness brighter than that is none
COARSE = 0.3  # counts of noise below which what is dim is rounded away (half a step's worth is 0.5)
BENT = 0.05  # relative difference of the rates of two exposures that a linear sensor does not show


def missing(device: CameraDeviceConfig | None) -> str | None:
    """What is wrong with a camera before it is opened, None where nothing is."""
    if device is None:
        return "FAIL camera: none is configured; name it under devices.camera"
    if not os.path.exists(device.device):
        others = ", ".join(str(p) for p in sorted(Path("/dev/v4l/by-id").glob("*"))) or "none"
        return f"FAIL camera: {device.device} is not there; plug it in, or name one of those found: {others}"
    if not os.access(device.device, os.R_OK | os.W_OK):
        return f"FAIL camera: {device.device} may not be opened; have your user added to its group (often video)"
    return None


def examine(config: RigConfig, source: FrameSource, light: Light | None) -> Iterator[str]:
    """Findings, in the order of the tests. Raises DeviceFault. Without a light of its own: in the dark only."""
    camera, ladder = Camera(source, config.camera), config.camera.exposure_s
    try:
        name, formats = source.describe()
        yield f"ok   camera: {name}, offers {', '.join(formats) or 'no format'}"
    except OSError as e:
        yield f"warn camera: does not say what it is: {e}"
    camera.configure()
    has = {n: source.get(n) for n in ("auto_exposure", "gain", "auto_white_balance", "white_balance", "gamma")}
    yield "ok   camera: set and read back: " + ", ".join(f"{n} {v:g}" for n, v in has.items() if v is not None)
    darks = [camera.frame(t).astype(float) for t in ladder]  # each exposure set and read back on the way
    height, width, planes = darks[0].shape
    if (width, height) != (config.camera.width, config.camera.height):
        yield f"FAIL camera: pictures are {width} x {height}; set camera.width and height to that"
    if max(config.camera.channels) >= planes:
        yield f"FAIL camera: frames have {planes} planes; camera.channels names plane {max(config.camera.channels)}"
        return
    grain = float(np.std(camera.more(ladder[-1]).astype(float) - darks[-1]) / np.sqrt(2))
    if grain < COARSE:
        what = f"noise of {grain:.2f} counts hides no step of its converter"
        yield f"warn camera: {what}; raise camera.gain, or take more bits"
    level = darks[-1].mean((0, 1))
    shown = ", ".join(f"{v:.3g}" for v in level)
    yield f"ok   camera: exposures {ladder[0]:g} to {ladder[-1]:g} s read back, dark level {shown} counts at last"
    if level.max() > STRAY * source.full_scale:
        yield f"warn camera: the dark is {level.max() / source.full_scale:.0%} of full scale; is there stray light?"
    if light is not None:
        yield from _lit(camera, darks, light)


def _lit(camera: Camera, darks: list[Array], light: Light) -> Iterator[str]:
    """The middle of the picture with the light on, exposure by exposure."""
    ladder, planes = camera.config.exposure_s, list(camera.config.channels)
    height, width, _ = darks[0].shape
    middle = slice(height // 3, -(height // 3)), slice(width // 3, -(width // 3))
    light.on()
    light.level(1)
    frames = [camera.frame(t, middle) for t in ladder]
    light.off()
    step = np.stack([(f - d[middle]).mean((0, 1))[planes] for f, d in zip(frames, darks)])  # (E, C)
    limit = NEAR_SATURATION * camera.source.full_scale
    clipped = np.stack([(f[..., planes] >= limit).any((0, 1)) for f in frames])
    clear = (step > 10 * camera.read_noise / np.sqrt(frames[0][..., 0].size)) & ~clipped
    if clipped[0].any():
        yield "warn camera: saturated in its shortest exposure; less light, a smaller aperture, or a shorter exposure"
    elif not clear.any(0).all():
        yield "FAIL light: switching it on changes nothing; is it aimed at the sample, the camera too?"
        return
    dark = np.stack([d[middle].mean((0, 1))[planes] for d in darks])
    most = np.where(clipped, 0, step / np.maximum(dark, 1)).max(0)
    yield f"ok   light: on/off contrast {', '.join(f'{v:.3g}' for v in most + 1)}"
    rate = step / np.array(ladder)[:, None]
    strong = clear & (step > 20 * camera.read_noise)  # so that noise does not count
    pairs = [(a[c], b[c]) for a, b, x, y in zip(rate, rate[1:], strong, strong[1:]) for c in np.flatnonzero(x & y)]
    if pairs and (worst := max(abs(a / b - 1) for a, b in pairs)) > BENT:
        yield f"warn camera: rates differ by {worst:.0%} from exposure to exposure; is its gamma fixed at linear?"
    elif pairs:
        yield f"ok   camera: linear to {worst:.1%} over {len(pairs)} pairs of exposures"


def look(config: RigConfig, source: FrameSource, light: Light | None) -> Iterator[str]:
    """`examine`, with what goes wrong said as a finding, and the sensor let go."""
    try:
        yield from examine(config, source, light)
    except DeviceFault as e:
        yield f"FAIL {e}"
    finally:
        source.close()
