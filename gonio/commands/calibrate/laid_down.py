"""What lies on a simulated rig when an operator is asked for it; None on a real one, where people lay it down."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gonio.config.rig import RigConfig
from gonio.rig.calibration import RadiometryCalibration, load_calibration

if TYPE_CHECKING:
    from calibration.board import Board
    from calibration.radiometry.certificate import Certificate


def channels(config: RigConfig) -> int:
    """How many a simulated detector has: what the rig says, or its radiometry, else three."""
    named = config.calibration.radiometry
    if config.channels is not None or named is None or not Path(named).is_file():
        return config.channels or 3
    return len(load_calibration(Path(named), RadiometryCalibration).gain)


def mirror(config: RigConfig, wedge_deg: float):
    """What lies on a simulated rig; None on a real one."""
    if config.depth == "real":
        return None
    from sim.mirror import Mirror

    return Mirror.on_wedge(wedge_deg, channels(config)) if wedge_deg else Mirror(channels=channels(config))


def reference(config: RigConfig, known: "Certificate"):
    """What lies on a simulated rig: the reference as certified; None on a real one."""
    if config.depth == "real":
        return None
    if len(known.f) == 1:
        from gonio.brdf.models.lambert import Lambert

        f = known.f[0]
        return Lambert(np.pi * (np.repeat(f, channels(config)) if len(f) == 1 else f))
    from sim.standard import Standard

    many = known.f.shape[1] if known.f.shape[1] > 1 else channels(config)
    return Standard(known.wi, known.wo, known.f, many)


def black(config: RigConfig, many: int):
    """What lies on a simulated rig when a trap is asked for; None on a real one."""
    if config.depth == "real":
        return None
    from gonio.brdf.models.lambert import Lambert

    return Lambert(np.zeros(many))


def board(config: RigConfig, board: "Board"):
    """What lies on a simulated rig when a board is asked for; None on a real one."""
    if config.depth == "real":
        return None
    from calibration.board import board_image
    from sim.board_on_plate import BoardOnPlate

    return BoardOnPlate(board_image(board, 60), board.across * board.square, channels(config))
