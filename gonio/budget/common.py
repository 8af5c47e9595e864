"""The parts of an uncertainty that all readings of a run have in common, as columns of relative errors."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from calibration.geometry.parameters import Parameters
from gonio.budget.angles import Angles, Value
from gonio.config.rig import RigConfig
from gonio.geometry import Array
from gonio.rig.calibration import GeometryCalibration, RadiometryCalibration
from gonio.rig.signal.radiometry import Radiometry

FAINT = 1e-12


@dataclass(frozen=True)
class Common:
    """Of one rig as calibrated, for a run of `hours`; value(wi, wo) is f as reconstructed, (N, C) in 1/sr.

    referenced: the lamp is followed during the run, so that its drift is in each reading's sigma.
    """

    config: RigConfig
    value: Value
    radiometry: RadiometryCalibration | None
    geometry: GeometryCalibration | None
    hours: float
    referenced: bool
    isotropic: bool = True
    _parts: list[tuple[str, Callable[[Array, Array, Array], Array]]] = field(default_factory=list)

    _angles: list[Angles] = field(default_factory=list)

    def __post_init__(self) -> None:
        if (r := self.radiometry) is not None:
            self._parts.extend(self._of_radiometry(r))
        if self.geometry is not None and self._tells_angles(self.geometry):
            angles = Angles(self.config, self.geometry, self.isotropic)
            self._angles.append(angles)
            both = lambda wi, wo, f: angles.columns(self.value, wi, wo, self._cosine)
            self._parts.append(("angles", lambda wi, wo, f: np.add(*both(wi, wo, f))))
        a = self.config.acceptance
        if a.light_half_angle_deg or a.detector_half_angle_deg:
            self._parts.append(("solid angles", self._solid_angles))

    def _tells_angles(self, geometry: GeometryCalibration) -> bool:
        """Whether its covariance is there, of all parameters."""
        return bool(geometry.covariance) and set(Parameters(self.config).names) <= set(geometry.parameters)

    @property
    def calibrated(self) -> bool:
        return self.radiometry is not None or self.geometry is not None

    @property
    def left_out(self) -> list[str]:
        """What is not in it, and what would bring it in."""
        lines = []
        if self.radiometry is None:
            lines.append(
                "gain, linearity, ranges, stray, drift: `gonio calibrate radiometry`, and its file in the rig's YAML"
            )
        elif self.config.detector == "camera":
            lines.append("linearity, stray, drift: not looked at with a camera")
        elif not self.radiometry.range_ratios:
            lines.append(
                "ranges, stray, drift: this calibration did not look; make it anew with `gonio calibrate radiometry`"
            )
        if self.geometry is None:
            lines.append("angles: `gonio calibrate geometry --mirror`, and its file in the rig's YAML")
        elif not self._tells_angles(self.geometry):
            lines.append("angles: this calibration has no covariance; make it anew with `gonio calibrate geometry`")
        lines.append("polarisation of lamp and detector: nothing here measures it")
        return lines

    def columns(self, wi: Array, wo: Array) -> Mapping[str, Array]:
        """By name: relative errors (K, N, C) at one standard deviation; columns of different names are independent."""
        f = np.maximum(self.value(wi, wo), FAINT)
        return {name: np.broadcast_to(p := part(wi, wo, f), (len(p), *f.shape)) for name, part in self._parts}

    def all_columns(self, wi: Array, wo: Array) -> Array:
        """As `columns`, in one: (K, N, C)."""
        parts = list(self.columns(wi, wo).values())
        return np.concatenate(parts) if parts else np.zeros((0, *self.value(wi, wo).shape))

    def u(self, wi: Array, wo: Array) -> Array:
        """Relative standard uncertainty (N, C) of all common parts together."""
        return np.asarray(np.sqrt((self.all_columns(wi, wo) ** 2).sum(0)))

    def of_angles(self, wi: Array, wo: Array) -> dict[str, Array]:
        """What the part `angles` is made of, relative (N, C): the slope of f, and the cosine it is divided by. They go
        together: their squares do not add up to its own."""
        found = {}
        for angles in self._angles:
            slope, cosine = angles.columns(self.value, wi, wo, self._cosine)
            found["angles x slope of f"] = np.sqrt((slope**2).sum(0))
            found["angles x footprint"] = np.sqrt((np.broadcast_to(cosine, slope.shape) ** 2).sum(0))
        return found

    def _of_radiometry(self, r: RadiometryCalibration):
        gain = np.array(r.gain)
        own = np.sqrt(np.maximum(np.array(r.gain_sigma) ** 2 - (gain * r.certificate_u) ** 2, 0)) / gain
        yield "certificate", lambda wi, wo, f: np.full((1, *f.shape), r.certificate_u)
        yield "gain", lambda wi, wo, f: np.broadcast_to(np.diag(own)[:, None], (len(own), *f.shape))
        if r.linearity_sigma:
            yield "linearity", lambda wi, wo, f: r.linearity_sigma * self._filling(f, wi, wo)[0][None]
        if r.range_ratios_sigma:
            sigma = np.array(r.range_ratios_sigma)
            which = np.arange(len(sigma))[:, None, None]
            yield "ranges", lambda wi, wo, f: np.where(self._filling(f, wi, wo)[1] == which, sigma[which], 0.0)
        if r.stray_sigma:
            stray = np.array(r.stray_sigma) / gain
            per = lambda wi, wo, f: stray / (f * np.maximum(self._cosine(wi, wo), 1e-3)[:, None])
            yield "stray", lambda wi, wo, f: np.eye(len(stray))[:, None] * per(wi, wo, f)[None]
        if not self.referenced and r.drift_per_h_sigma:
            # readings come in any order: in the mean of a run the lamp is half its drift beside its start
            drift = float(np.hypot(r.drift_per_h, r.drift_per_h_sigma)) * self.hours / 2
            yield "drift", lambda wi, wo, f: np.full((1, *f.shape), drift)

    def _cosine(self, wi: Array, wo: Array) -> Array:
        return np.maximum((wi if self.config.footprint == "overfilled" else wo)[:, 2], 0.0)

    def _filling(self, f: Array, wi: Array, wo: Array) -> tuple[Array, Array]:
        """How full the range is in which f is read (N, C), and which range that is."""
        r = self.radiometry
        assert r is not None
        known = Radiometry(np.array(r.gain), np.zeros(len(r.gain)), self.config.footprint)
        signal = f * known.gain * self.config.exposure_s * self._cosine(wi, wo)[:, None]
        full = np.array(self.config.full_scales)
        which = np.minimum(np.searchsorted(full, signal), len(full) - 1)
        return np.minimum(signal / full[which], 1.0), which

    def _solid_angles(self, wi: Array, wo: Array, f: Array) -> Array:
        """What points in place of cones leave out, f's curvature over them, not corrected: (1, N, C)."""
        a, total = self.config.acceptance, np.zeros_like(f)
        for half, which in ((a.light_half_angle_deg, 0), (a.detector_half_angle_deg, 1)):
            if half:
                total += _over_disk(self.value, (wi, wo), which, np.radians(half)) / f - 1
        return np.clip(np.abs(total), 0, 1)[None]


def _over_disk(value: Value, pair: tuple[Array, Array], which: int, half: float) -> Array:
    """Mean of f over a disk about one direction, exact to third order: four points at half / sqrt 2."""
    w = pair[which]
    x = np.cross(w, np.eye(3)[np.abs(w).argmin(1)])
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    y = np.cross(w, x)
    r = half / np.sqrt(2)
    around = [np.cos(r) * w + np.sin(r) * d for d in (x, -x, y, -y)]
    return np.asarray(np.mean([value(*((d, pair[1]) if which == 0 else (pair[0], d))) for d in around], 0))
