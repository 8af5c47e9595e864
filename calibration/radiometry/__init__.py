"""Radiometry of a rig: what its detector makes of light, from a white reference of known f and a black trap."""

from calibration.radiometry.certificate import Certificate, read_certificate
from calibration.radiometry.reference import calibrate_radiometry, measure_reference, take_readings
from calibration.radiometry.session import Session

__all__ = [
    "Certificate",
    "Session",
    "calibrate_radiometry",
    "measure_reference",
    "read_certificate",
    "take_readings",
]
