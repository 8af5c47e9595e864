"""Radiometry: dark level, linearity and gain of the detector, from a white reference of known f.

Put the reference in the sample's place, drive to a pose whose f the certificate gives (0/45 is usual), and take: dark
readings with the light off, readings at exposures of 1/8 to as much as the detector takes, readings at the exposure of
the run. Real white standards are not Lambertian: f belongs to the geometry, not to the material.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from calibration.stamp import stamp
from gonio.geometry import Array, from_angles
from gonio.rig.calibration import RadiometryCalibration
from gonio.rig.devices import Detector, Light, Reading
from gonio.rig.errors import CalibrationMissing
from gonio.rig.staged import StagedRig

REPEATS = 16


def calibrate_radiometry(
    dark: Sequence[Reading],
    white: Sequence[Reading],
    reference_f: Array,
    cosine: float,
    rig: str,
    simulated: bool = False,
    detector: str = "photodiode",
) -> RadiometryCalibration:
    """Gain (C,) and linearity from readings of the reference, f (C,), at any exposures.

    cosine is that of theta_i (light overfills the detector's view) or theta_o. Raises CalibrationMissing where the
    reference was too dark, saturated, or seen at one exposure only (no linearity then: it is taken as 0).
    """
    from scipy.optimize import least_squares

    good = [r for r in white if not r.saturated]
    if len(good) < 4 or len(dark) < 4:
        raise CalibrationMissing("radiometry: four dark and four unsaturated white readings are the least; take more")
    if cosine < 0.1:
        raise CalibrationMissing(f"radiometry: the reference is lit at a cosine of {cosine:.2f}; take 0.1 or more")
    seconds = np.array([r.raw["exposure_s"] for r in good])[:, None]
    value, sigma = np.array([r.value for r in good]), np.array([r.sigma for r in good])
    full = np.array([r.raw.get("full_scale", [np.inf] * value.shape[1]) for r in good], float)
    level = np.mean([r.value / r.raw["exposure_s"] for r in dark], 0)
    rate = np.median((value - level * seconds) / seconds, 0)
    noise = np.sqrt(np.mean([r.sigma**2 / r.raw["exposure_s"] ** 2 for r in dark], 0) / len(dark))
    if np.any(rate < 20 * noise):
        raise CalibrationMissing("radiometry: the reference is hardly brighter than the dark; is the light on?")

    def residual(p: Array) -> Array:
        signal = (p[1:] + level) * seconds
        return ((signal * (1 + p[0] * signal / full) - value) / sigma).ravel()

    varied = seconds.max() > 2 * seconds.min() and bool(np.isfinite(full).all())
    bound = 0.2 if varied else 1e-12
    low, high = np.append(-bound, np.zeros_like(rate)), np.append(bound, np.full_like(rate, np.inf))
    fit = least_squares(residual, np.append(0.0, rate), bounds=(low, high), x_scale=np.append(0.01, rate))
    covariance = np.linalg.pinv(fit.jac.T @ fit.jac)
    spread = np.sqrt(np.diag(covariance))
    per_f = reference_f * cosine
    found: dict[str, Any] = {
        "gain": tuple((fit.x[1:] / per_f).tolist()),
        "gain_sigma": tuple((np.hypot(spread[1:], noise) / per_f).tolist()),
        "dark": tuple(level.tolist()),
        "linearity": float(fit.x[0]) if varied else 0.0,
        "linearity_sigma": float(spread[0]) if varied else 0.0,
    }
    return RadiometryCalibration(**stamp("radiometry", found, rig, simulated), detector=detector, **found)


def take_readings(detector: Detector, light: Light, exposure: float) -> tuple[list[Reading], list[Reading]]:
    """Dark and white readings for `calibrate_radiometry`, the reference being in place. The light is off afterwards."""
    light.off()
    dark = [detector.read(exposure) for _ in range(REPEATS)]
    light.on()
    try:
        white = [detector.read(exposure * 2.0**k) for k in range(-3, 4) for _ in range(REPEATS)]
    finally:
        light.off()
    return dark, white


def measure_reference(
    rig: StagedRig, theta_i_deg: float, theta_o_deg: float, reference_f: Array
) -> RadiometryCalibration:
    """Drive a rig with the reference on it to the geometry of its certificate (light and detector opposite each other,
    phi = 180 degrees), take the readings and reduce them. Raises CalibrationMissing, SafetyStop, DeviceFault.
    """
    wi, wo = from_angles(np.radians([theta_i_deg]), 0.0), from_angles(np.radians([theta_o_deg]), np.pi)
    return calibrate_at(rig, wi, wo, reference_f)


def calibrate_at(rig: StagedRig, wi: Array, wo: Array, reference_f: Array, u: float = 0.0) -> RadiometryCalibration:
    """As `measure_reference`, at a pair (1, 3), (1, 3); u: relative standard uncertainty of the reference."""
    if not rig.reachable(wi, wo)[0]:
        theta = np.degrees(np.arctan2(np.hypot(*np.array([wi[0], wo[0]]).T[:2]), [wi[0, 2], wo[0, 2]]))
        raise CalibrationMissing(
            f"radiometry: {theta[0]:.3g}/{theta[1]:.3g} degrees is out of rig {rig.config.name}'s reach"
        )
    wi_0, wo_0 = rig.drive(wi, wo)  # as achieved
    rig.announce(-(1 << 41))
    dark, white = take_readings(rig.detector, rig.light, rig.config.exposure_s)
    cosine = rig.radiometry.cosine(wi_0, wo_0)
    args = reference_f, cosine, rig.config.name, rig.simulated, rig.config.detector_kind
    found = calibrate_radiometry(dark, white, *args)
    sigma = np.hypot(found.gain_sigma, u * np.array(found.gain))
    return found.model_copy(update={"gain_sigma": tuple(sigma.tolist()), "certificate_u": u})
