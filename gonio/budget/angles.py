"""What a geometry that is known so well does to f: slope of f, and of the cosine it is divided by, times the angles."""

from collections.abc import Callable

import numpy as np

from calibration.geometry.parameters import Parameters
from gonio.config.rig import RigConfig
from gonio.geometry import Array, unit
from gonio.rig.build import envelope_of
from gonio.rig.calibration import GeometryCalibration

STEP = 1e-5
Value = Callable[[Array, Array], Array]  # f (N, C) of pairs


class Angles:
    """The errors of a calibrated geometry, as columns, one for each independent way in which it may be wrong."""

    def __init__(self, config: RigConfig, geometry: GeometryCalibration, isotropic: bool = True):
        self.isotropic = isotropic
        self.parameters = Parameters(config)
        names = list(geometry.parameters)
        kept = [names.index(n) for n in self.parameters.names]
        self.p = np.array([geometry.parameters[n] for n in self.parameters.names])
        covariance = np.array(geometry.covariance)[np.ix_(kept, kept)]
        size, ways = np.linalg.eigh(0.5 * (covariance + covariance.T))
        self._ways = ways * np.sqrt(np.maximum(size, 0))  # (P, K): one standard deviation each
        self._kinematics = self.parameters.kinematics(self.p)
        self._envelope = envelope_of(config, geometry)

    def shifts(self, wi: Array, wo: Array) -> tuple[Array, Array]:
        """By how much directions (N, 3) are elsewhere than believed: (K, N, 3) each. 0 where the rig cannot be.

        Of an isotropic sample without what turns both about the normal: nothing depends on that, and no mirror tells
        it.
        """
        poses, ok = self._envelope.fit(self._kinematics.inverse(wi, wo, np.zeros(len(self._envelope.axes))))
        branch = (ok & np.isfinite(poses).all(-1)).argmax(1)
        pose = poses[np.arange(len(wi)), branch]
        reached = np.isfinite(pose).all(1)
        pose = np.where(reached[:, None], pose, 0.0)
        d_light, d_detector = [], []
        for step in STEP * np.eye(len(self.p)):
            (ai, ao), (bi, bo) = (self.parameters.kinematics(self.p + s).forward(pose) for s in (step, -step))
            d_light.append((ai - bi) / (2 * STEP))
            d_detector.append((ao - bo) / (2 * STEP))
        along = lambda d: np.einsum("pnx,pk->knx", np.array(d), self._ways) * reached[:, None]
        light, detector = along(d_light), along(d_detector)
        if self.isotropic:
            a, b = (np.stack([-w[:, 1], w[:, 0], 0 * w[:, 0]], -1) for w in (wi, wo))
            turn = (light * a + detector * b).sum(-1) / np.maximum((a * a + b * b).sum(-1), 1e-12)
            light, detector = light - turn[..., None] * a, detector - turn[..., None] * b
        return light, detector

    def columns(
        self, value: Value, wi: Array, wo: Array, cosine: Callable[[Array, Array], Array]
    ) -> tuple[Array, Array]:
        """Relative errors of f by its slope, and by the cosine's: (K, N, C) and (K, N, 1)."""
        light, detector = self.shifts(wi, wo)
        k, n, _ = light.shape
        here = np.maximum(value(wi, wo), 1e-300)
        flat = lambda w, d: unit((w + d).reshape(-1, 3))
        forth, back = (value(flat(wi, s * light), flat(wo, s * detector)).reshape(k, n, -1) for s in (1, -1))
        slope = np.clip((forth - back) / (2 * here), -1, 1)
        c = np.maximum(cosine(wi, wo), 1e-6)
        c_forth, c_back = (cosine(flat(wi, s * light), flat(wo, s * detector)).reshape(k, n) for s in (1, -1))
        return slope, np.clip((c_forth - c_back) / (2 * c), -1, 1)[..., None]
