"""A rig calibrates its detector by itself: darks, photon transfer, linearity, gain by a reference, stray by a trap."""

import json
from collections.abc import Callable
from typing import Any

import numpy as np

from calibration.radiometry.certificate import Certificate, within_reach
from calibration.radiometry.curve import BEND, RATIO, Curve, Point, fit_curve, photon_transfer
from calibration.radiometry.stability import Stability, stability
from calibration.stamp import stamp
from gonio.geometry import Array, from_angles
from gonio.rig.calibration import RadiometryCalibration
from gonio.rig.errors import CalibrationMissing
from gonio.rig.signal.radiometry import Radiometry
from gonio.rig.staged import StagedRig

LEVELS = (1.0, 0.25, 1 / 16, 1 / 64)  # of the lamp
EXPOSURES = (1 / 8, 1 / 2, 2.0, 8.0, 32.0, 128.0, 512.0)  # of the nominal one
LONGEST_S = 12.0  # an exposure beyond this is left out
READINGS, PATIENCE_S = 24, 8.0  # of one level and exposure; seconds after which fewer do
GAINS, GAIN_LONGER = 48, 4.0  # readings of the reference at one angle, and their exposure beside the nominal one
STEEPEST = 0.1  # cosine at which a reference may be lit
SPIKE = 6.0  # sigmas off the median of its like
LINEAR = 0.02  # misses of the curve beyond this are not a curve
STRAY_AT = ((-45.0, 45.0, 90.0), (-20.0, 60.0, 180.0), (30.0, 30.0, 120.0))  # theta_i, theta_o, phi
STEADY, STEADY_S = (128.0, 32.0, 8.0, 2.0, 0.5, 0.1), 3.0  # exposures of the lamp's drift, and the longest, s
NUMBERS = -(1 << 44)


class Session:
    """One rig with a photodiode: what was read so far, and what follows from it. say(text) tells the operator."""

    def __init__(
        self, certificate: Certificate, say: Callable[[str], None] = lambda text: None, stability_s: float = 300.0
    ):
        self.certificate, self.say, self.stability_s = certificate, say, stability_s
        self.said = certificate.digest  # before an angle is moved into reach
        self.points: list[Point] = []
        self.angles: list[tuple[int, Array, Array, float]] = []  # which row, gain (C,), its sigma (C,), cosine
        self.stray, self.stray_sigma = np.zeros(0), np.zeros(0)
        self._number = NUMBERS

    def measure_white(self, rig: StagedRig) -> None:
        """All that the reference tells; it lies there now. Raises CalibrationMissing, SafetyStop, DeviceFault."""
        try:
            self.certificate.confirm_channels(rig.channels)
            rig.light.off()
            self.dark, self.dark_points = self._darks(rig)
            self.certificate, reach = within_reach(self.certificate, rig.reachable)
            self.used = [k for k in self.certificate.used.tolist() if reach[k]]
            if not self.used:
                raise CalibrationMissing(f"radiometry: no angle of the certificate is in rig {rig.config.name}'s reach")
            for k in self.used:
                cosine = rig.radiometry.cosine(self.certificate.wi[k], self.certificate.wo[k])
                if cosine < STEEPEST:
                    raise CalibrationMissing(
                        f"radiometry: row {k + 1} of the certificate is lit at a cosine of {cosine:.2f}; leave it out"
                    )
            self._drive(rig, self.used[len(self.used) // 2])
            rig.light.on()
            rig.light.level(1)
            self._began = rig.clock.now()
            self.steady = self._stability(rig)
            self._curve(rig)
            known = self._radiometry(rig)
            for k in self.used:
                self.say(f"reference at angle {k + 1} of {len(self.certificate.f)}")
                wi, wo = self._drive(rig, k)
                self.angles.append((k, *self._gain(rig, known, wi, wo, k)))
        finally:
            rig.light.off()

    def measure_trap(self, rig: StagedRig) -> None:
        """Stray light: what the detector sees of the lit lamp where there is nothing to see. A black trap lies there
        now."""
        known, e = self._radiometry(rig), rig.config.exposure_s
        seen, noise = [], []
        try:
            rig.light.on()
            for theta_i, theta_o, phi in STRAY_AT:
                wi, wo = (
                    from_angles(np.radians([abs(theta_i)]), 0.0),
                    from_angles(np.radians([theta_o]), np.radians(phi)),
                )
                if not rig.reachable(wi, wo)[0]:
                    continue
                rig.drive(wi, wo)
                rig.light.level(0)
                off, off_sigma = self._mean(rig, known, 8 * e, READINGS)
                rig.light.level(1)
                on, on_sigma = self._mean(rig, known, 8 * e, READINGS)
                seen.append((on - off) / (8 * e))
                noise.append(np.hypot(on_sigma, off_sigma) / (8 * e))
        finally:
            rig.light.off()
        if not seen:
            raise CalibrationMissing(f"radiometry: rig {rig.config.name} reaches no pose at which to look at the trap")
        self.stray = np.mean(seen, 0)
        self.stray_sigma = np.hypot(np.std(seen, 0), np.sqrt(np.mean(np.square(noise), 0) / len(seen)))

    def record(self) -> str:
        """All that was read so far, as JSON: for whoever wants to know what went wrong."""
        plain = lambda x: x.tolist() if isinstance(x, np.ndarray) else x
        points = [{k: plain(v) for k, v in vars(p).items()} for p in self.points]
        angles = [{"row": k, "gain": plain(g), "sigma": plain(s), "cosine": float(c)} for k, g, s, c in self.angles]
        return json.dumps({"points": points, "angles": angles, "stray": plain(self.stray)}, indent=1)

    def result(self, rig: StagedRig) -> RadiometryCalibration:
        """Raises CalibrationMissing where the readings are no curve, or the reference is not what its table says."""
        rms = float(np.sqrt(np.mean(self._bright(self.curve.off) ** 2)))
        if rms > LINEAR:
            raise CalibrationMissing(
                f"radiometry: readings miss any smooth curve by {rms:.1%}; is the lamp steady, and its cable tight?"
            )
        gains = np.array([g for _, g, _, _ in self.angles])
        if len(self.stray):  # the trap comes last; the reference was read with the same stray light on it
            gains = gains - np.array([self.stray / (self.certificate.f[k] * c) for k, _, _, c in self.angles])
        sigmas = np.array([s for _, _, s, _ in self.angles])
        u = self.certificate.u[self.used]
        gain = gains.mean(0)
        scatter = gains.std(0, ddof=1) / np.sqrt(len(gains)) if len(gains) > 1 else np.zeros_like(gain)
        spread = float((gains.std(0) / gain).max()) if len(gains) > 1 else 0.0
        if spread > max(0.05, 4 * float(u.mean())):
            raise CalibrationMissing(
                f"radiometry: the gain differs by {spread:.0%} from angle to angle; calibrate the geometry first, "
                "or is it another reference than its table's?"
            )
        random = np.sqrt(np.mean(sigmas**2, 0) / len(gains))
        shot, read = photon_transfer(self.points + self.dark_points, self.dark, rig.config.exposure_s)
        c = self.curve
        found: dict[str, Any] = {
            "gain": tuple(gain.tolist()),
            "gain_sigma": tuple(np.sqrt(random**2 + scatter**2 + (gain * u.mean()) ** 2).tolist()),
            "dark": tuple(self.dark[1].tolist()),
            "dark_offset": tuple(self.dark[0].tolist()),
            "linearity": c.linearity,
            "linearity_sigma": c.linearity_sigma,
            "range_ratios": tuple(c.ratios.tolist()),
            "range_ratios_sigma": tuple(c.ratios_sigma.tolist()),
            "stray": tuple(self.stray.tolist()),
            "stray_sigma": tuple(self.stray_sigma.tolist()),
            "drift_per_h": c.drift * 3600,
            "drift_per_h_sigma": c.drift_sigma * 3600,
            "warm_up_s": self.steady.warm_s,
            "shot_noise": shot,
            "read_noise": read,
            "curve_rms": rms,
            "certificate_u": float(u.mean()),
            "reference": self.said,
            "detector": rig.config.detector_kind,
        }
        return RadiometryCalibration(**stamp("radiometry", found, rig.config, rig.simulated), **found)

    def _drive(self, rig: StagedRig, k: int) -> tuple[Array, Array]:
        return rig.drive(self.certificate.wi[k : k + 1], self.certificate.wo[k : k + 1])

    def _darks(self, rig: StagedRig) -> tuple[Array, list[Point]]:
        """Signal at no exposure and a second (2, C), by a line through darks of many exposures; and these."""
        points = [p for t in EXPOSURES[:5] for p in self._points(rig, -1, t * rig.config.exposure_s, 0.0)]
        t = np.array([p.seconds for p in points])
        weight = 1 / np.array([np.maximum(p.sigma, 1e-300) for p in points])
        both = [
            np.linalg.lstsq(np.stack([w, w * t], 1), w * v, rcond=None)[0]
            for w, v in zip(weight.T, np.array([p.value for p in points]).T)
        ]
        return np.array(both).T, points

    def _stability(self, rig: StagedRig) -> Stability:
        """The lamp's drift, by readings as long as the detector takes."""
        longest = next((t for t in STEADY if t * rig.config.exposure_s <= STEADY_S), STEADY[-1])
        seconds = longest * rig.config.exposure_s
        self._announce(rig)
        while seconds > rig.config.exposure_s and rig.detector.read(seconds).saturated:
            seconds /= 4
        times, signals = [], []
        self.say(f"the lamp's drift, {self.stability_s / 60:.0f} min")
        while (now := rig.clock.now() - self._began) < self.stability_s:
            reading = rig.detector.read(seconds)
            times.append(now)
            signals.append(float(reading.value.sum()))
        return stability(np.array(times), np.array(signals))

    def _curve(self, rig: StagedRig) -> None:
        for k, level in enumerate(LEVELS):
            rig.light.level(level)
            self.say(f"linearity at lamp level {level:g}")
            for t in EXPOSURES:
                if t * rig.config.exposure_s <= LONGEST_S:
                    self.points += self._points(rig, k, t * rig.config.exposure_s, rig.clock.now() - self._began)
        rig.light.level(1)
        self.points += self._points(rig, 0, rig.config.exposure_s, rig.clock.now() - self._began)
        lit = [p for p in self.points if p.level == 0]
        if len(lit) < 4:
            raise CalibrationMissing("radiometry: the reference saturates the detector; put a filter before the lamp")
        light = np.array(
            [(p.value - self.dark[0] - self.dark[1] * p.seconds) / np.maximum(p.sigma, 1e-300) for p in lit]
        )
        if np.any(np.median(light, 0) < 20):
            raise CalibrationMissing("radiometry: the reference is hardly brighter than the dark; is the lamp on?")
        drift = self.steady.drift, self.steady.drift_sigma
        accuracy = rig.config.accuracy
        known = (BEND, RATIO) if accuracy is None else (accuracy, accuracy)
        self.curve: Curve = fit_curve(self.points, self.dark, len(rig.config.full_scales), drift, known)

    def _points(self, rig: StagedRig, level: int, seconds: float, time: float) -> list[Point]:
        """Readings at one level and exposure, by the ranges they were read in; none where they saturate."""
        n = max(min(READINGS, int(PATIENCE_S / seconds)), 2)
        self._announce(rig)
        readings = [rig.detector.read(seconds) for _ in range(n)]
        groups: dict[tuple[int, ...], list] = {}
        for r in readings:
            if not r.saturated:
                groups.setdefault(tuple(r.raw.get("range", [0] * len(r.value))), []).append(r)
        found = []
        for ranges, group in groups.items():
            good = unspiked(np.array([r.value for r in group]), np.array([r.sigma for r in group]))
            group = [r for r, g in zip(group, good) if g]
            values = np.array([r.value for r in group])
            sigma = np.sqrt(np.mean([r.sigma**2 for r in group], 0) / len(group))
            full = np.array(group[0].raw.get("full_scale", [np.inf] * values.shape[1]), float)
            scatter = values.std(0, ddof=1) if len(group) > 1 else np.full(values.shape[1], np.nan)
            exposed = float(group[0].raw["exposure_s"])  # a detector may not have the time that it is asked for
            found.append(Point(level, exposed, time, ranges, full, values.mean(0), sigma, scatter, len(group)))
        return found

    def _radiometry(self, rig: StagedRig) -> Radiometry:
        """By the curve alone: its gain means nothing."""
        one = np.ones(rig.channels)
        return Radiometry(one, 0 * one, rig.config.footprint, self.curve.linearity, ratios=self.curve.ratios)

    def _mean(self, rig: StagedRig, known: Radiometry, seconds: float, n: int) -> tuple[Array, Array]:
        self._announce(rig)
        values, sigmas = (np.array(x) for x in zip(*(known.signal(rig.detector.read(seconds)) for _ in range(n))))
        good = unspiked(values, sigmas)
        values, sigmas, n = values[good], sigmas[good], int(good.sum())
        scatter = values.std(0, ddof=1) if n > 1 else 0.0
        return values.mean(0), np.maximum(np.sqrt(np.mean(sigmas**2, 0)), scatter) / np.sqrt(n)

    def _gain(self, rig: StagedRig, known: Radiometry, wi: Array, wo: Array, k: int) -> tuple[Array, Array, float]:
        """Signal a second of f = 1 at full projection (C,), freed of drift, its sigma, and the cosine."""
        e, cosine = rig.config.exposure_s, known.cosine(wi, wo)
        e *= GAIN_LONGER
        value, sigma = self._mean(rig, known, e, GAINS)
        lamp = 1 + self.curve.drift * (rig.clock.now() - self._began)
        per = self.certificate.f[k] * cosine * e * lamp
        return (value - self.dark[0] - self.dark[1] * e) / per, sigma / per, cosine

    def _bright(self, off: Array) -> Array:
        """Relative misses of points that noise does not hide."""
        noise = np.array([p.sigma / np.maximum(np.abs(p.value), 1e-300) for p in self.points])
        return off[noise < 0.005]

    def _announce(self, rig: StagedRig) -> None:
        rig.announce(self._number)
        self._number -= 1


def unspiked(values: Array, sigmas: Array) -> Array:
    """Which readings (N,) stand by the others in all channels (N, C): a spike is no reading."""
    off = np.abs(values - np.median(values, 0))
    usual = np.maximum(1.4826 * np.median(off, 0), np.median(sigmas, 0))
    return np.asarray((off <= SPIKE * usual + 1e-300).all(1))
