"""Geometry of a rig: what it differs in from its drawing, from what it was seen to show."""

from calibration.geometry.fit import Fit, calibrate_geometry, fit_geometry
from calibration.geometry.observations import Observation, read_observations, write_observations
from calibration.geometry.parameters import Parameters

__all__ = [
    "Fit",
    "Observation",
    "Parameters",
    "calibrate_geometry",
    "fit_geometry",
    "read_observations",
    "write_observations",
]
