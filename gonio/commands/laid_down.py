"""What lies on a simulated rig when an operator is asked for it; None on a real one, where people lay it down."""

from typing import TYPE_CHECKING

import numpy as np

from gonio.config.rig import RigConfig

if TYPE_CHECKING:
    from calibration.board import Board
    from calibration.radiometry.certificate import Certificate


def mirror(config: RigConfig, wedge_deg: float):
    """What lies on a simulated rig; None on a real one."""
    if config.depth == "real":
        return None
    from sim.mirror import Mirror

    return Mirror.on_wedge(wedge_deg) if wedge_deg else Mirror()


def reference(config: RigConfig, known: "Certificate"):
    """What lies on a simulated rig: the reference as certified; None on a real one."""
    if config.depth == "real":
        return None
    if len(known.f) == 1:
        from gonio.brdf.models.lambert import Lambert

        f = known.f[0]
        return Lambert(np.pi * (np.repeat(f, config.channels or 3) if len(f) == 1 else f))
    from sim.standard import Standard

    channels = known.f.shape[1] if known.f.shape[1] > 1 else config.channels or 3
    return Standard(known.wi, known.wo, known.f, channels)


def black(config: RigConfig, channels: int):
    """What lies on a simulated rig when a trap is asked for; None on a real one."""
    if config.depth == "real":
        return None
    from gonio.brdf.models.lambert import Lambert

    return Lambert(np.zeros(channels))


def board(config: RigConfig, board: "Board"):
    """What lies on a simulated rig when a board is asked for; None on a real one."""
    if config.depth == "real":
        return None
    from calibration.board import board_image
    from sim.board_on_plate import BoardOnPlate

    return BoardOnPlate(board_image(board, 60), board.across * board.square, config.channels or 3)
