"""A camera as the rig's detector: the mean over the patch of the sample that the arms' pose shows.

Each channel is read at the longest exposure in which none of its pixels is saturated. Which one that is follows from
what is seen, not from where the search began, so that a run that was interrupted reads the same. Where a prediction is
right (`expect`), the search is over with the first frame.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.camera import Camera, Window
from drivers.hdr import NEAR_SATURATION
from gonio.geometry import Array
from gonio.rig.devices import Reading

SURELY = 1.1  # times saturation: what is predicted so bright need not be tried
FEWEST = 4  # pixels of a patch seen almost edge on, below which there is no reading

Region = Callable[[], tuple[slice, slice, NDArray[np.bool_]]]  # rows, columns, which pixels of that window


class CameraDetector:
    """Implements `gonio.rig.devices.Detector`. Signals are counts in the nominal exposure, dark frames taken off.

    region() says where the patch is in the picture, at the pose that the rig has now.
    """

    def __init__(self, camera: Camera, exposure: float, region: Region):
        self.camera, self.exposure, self.region = camera, exposure, region
        self.ladder = camera.config.exposure_s
        self.planes = list(camera.config.channels)
        self._guess = len(self.ladder) // 2

    @property
    def channels(self) -> int:
        return len(self.planes)

    def expect(self, signal: Array | None) -> None:
        """Begin with the exposure that suits the brightest channel."""
        if signal is not None and np.isfinite(signal).all():
            rate = max(float(np.max(signal)) / self.exposure, 0.0)
            room = 0.5 * self.camera.source.full_scale  # half full: a prediction is no measurement
            fitting = [n for n, t in enumerate(self.ladder) if rate * t <= room]
            self._guess = fitting[-1] if fitting else 0

    def read(self, exposure: float | None = None) -> Reading:
        """Frames that have settled, of the exposures that the patch needs. NaN where it is seen too much edge on.

        Raises DeviceFault where no frames come, or the patch lies outside the picture.
        """
        seconds = exposure or self.exposure
        rows, columns, patch = self.region()
        window = rows, columns
        good = patch & ~self.camera.known().bad[window]
        raw: dict[str, Any] = {"exposure_s": seconds, "pixels": int(good.sum())}
        if good.sum() < FEWEST:
            nothing = np.full(self.channels, np.nan)
            return Reading(nothing, nothing, False, raw)
        taken, used, clipped = self._search(window, good)
        p = self.camera.merged({n: taken[n] for n in used}, window)
        value, sigma = p.value[good][:, self.planes], p.sigma[good][:, self.planes]
        raw["exposures_s"] = [self.ladder[n] for n in used]
        raw["counts"] = [taken[n][good][:, self.planes].mean(0).tolist() for n in used]
        noise = np.sqrt((sigma**2).sum(0)) / good.sum()
        return Reading(value.mean(0) * seconds, noise * seconds, clipped, raw)

    def _search(self, window: Window, good: NDArray[np.bool_]) -> tuple[dict[int, NDArray], list[int], bool]:
        """Frames taken, the numbers of those that count, and whether even the shortest exposure is too long."""
        taken: dict[int, NDArray] = {}
        too_long = np.full(self.channels, len(self.ladder))  # shortest exposure known to saturate
        n = self._guess
        while True:
            taken[n] = self.camera.frame(self.ladder[n], window)
            pixels = taken[n][good][:, self.planes]
            over = (pixels >= NEAR_SATURATION * self.camera.source.full_scale).any(0)
            too_long = np.where(over, np.minimum(too_long, n), too_long)
            wanted = [self._longest(c, int(too_long[c]), taken, window, good) for c in range(self.channels)]
            missing = [m for m in wanted if m not in taken]
            if not missing:
                break
            n = max(missing)
        self._guess = int(np.median(wanted))
        return taken, sorted(set(wanted)), bool((too_long == 0).any())

    def _longest(
        self, c: int, too_long: int, taken: dict[int, NDArray], window: Window, good: NDArray[np.bool_]
    ) -> int:
        """The longest exposure that may do for a channel, by the longest frame of it that has not clipped."""
        fine = [n for n in taken if n < too_long]
        if not fine:
            return max(too_long - 1, 0)
        best, plane = max(fine), self.planes[c]
        dark = self.camera.known().dark
        light = (taken[best][..., plane] - dark[best][window][..., plane])[good].mean()
        limit = SURELY * NEAR_SATURATION * self.camera.source.full_scale
        for n in range(too_long - 1, best, -1):
            level = dark[n][window][..., plane][good].mean() + light * self.ladder[n] / self.ladder[best]
            if level < limit:
                return n
        return best

    def state(self) -> dict[str, Any]:
        """Where the next search begins: costs time only."""
        return {"guess": self._guess}

    def restore(self, state: dict[str, Any]) -> None:
        self._guess = int(state["guess"])
