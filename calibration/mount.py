"""Mount: where the camera sits on its arm, from views of a board that lies in the sample's place, at known poses.

    pixel = project(R A(pose) (B x + b) + t)

R, t the mount, B, b where the board lies, both unknown: twelve numbers, by least squares over all corners of all views
(hand and eye together; Tsai & Lenz 1989 for what can be told: turns about two axes that are not parallel). The board
need not lie in the sample's middle, nor flat.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from calibration.board import Corners
from calibration.rows import number, read_rows
from gonio.config.rig import RigConfig
from gonio.geometry import Array
from gonio.rig.build import geometry_calibration, view_of
from gonio.rig.calibration import CameraCalibration
from gonio.rig.errors import CalibrationMissing
from gonio.rig.signal.view import View, rotation_of

FEWEST = 6  # views
UNSURE_MM = 0.5  # a mount known no better is not known


def calibrate_mount(
    camera: CameraCalibration, corners: Sequence[Corners], poses: Sequence[Array], config: RigConfig
) -> CameraCalibration:
    """The camera with its mount, from corners seen at encoder poses (V, A) in radians.

    Raises CalibrationMissing where views are too few or too alike, or no mount explains them.
    """
    from scipy.optimize import least_squares

    if len(corners) < FEWEST:
        raise CalibrationMissing(f"camera: {len(corners)} views with a pose, {FEWEST} are the least for its mount")
    drawn = view_of(config, geometry_calibration(config), camera)

    def residual(p: Array) -> Array:
        seen = View(drawn.matrix, drawn.distortion, drawn.size, rotation_of(p[:3]), p[3:6], drawn.arm)
        lying = rotation_of(p[6:9])
        parts = [seen.project(c.on_board @ lying.T + p[9:], pose) - c.in_view for c, pose in zip(corners, poses)]
        return np.nan_to_num(np.concatenate(parts).ravel(), nan=1e4)

    fit = least_squares(residual, _start(drawn, corners[0], poses[0]), x_scale="jac", loss="soft_l1")
    off = residual(fit.x)
    rms = float(np.sqrt(2 * np.mean(off**2)))
    if rms > 5:
        raise CalibrationMissing(
            f"camera: no mount explains the views ({rms:.0f} pixels off); check the poses, their order and signs"
        )
    strength, ways = np.linalg.eigh(fit.jac.T @ fit.jac)
    spread = ways[3:6] ** 2 / np.maximum(strength, 1e-9 * strength.max())  # of its place, in metres, per pixel
    unsure = 1000 * max(rms, 0.1) * float(np.sqrt(spread.sum()))
    if unsure > UNSURE_MM:
        raise CalibrationMissing(
            f"camera: the views tell its place to {unsure:.1f} mm only; turn table and arm more from view to view"
        )
    found = {"mount_rotation": tuple(fit.x[:3].tolist()), "mount_m": tuple(fit.x[3:6].tolist()), "mount_rms_px": rms}
    return camera.model_copy(update=found)


def _start(drawn: View, corners: Corners, pose: Array) -> Array:
    """The mount as drawn, and the board where the first view sees it from there."""
    import cv2

    _, turn, shift = cv2.solvePnP(corners.on_board, corners.in_view, drawn.matrix, drawn.distortion)
    into = (drawn.rotation @ drawn.arm(pose)).T
    lying, _ = cv2.Rodrigues(into @ cv2.Rodrigues(turn)[0])
    mount, _ = cv2.Rodrigues(drawn.rotation)
    place = into @ (shift.ravel() - drawn.translation)
    return np.concatenate([mount.ravel(), drawn.translation, lying.ravel(), place])


def read_poses(path: Path, config: RigConfig) -> dict[str, Array]:
    """Poses (A,) in radians by file name of the view: CSV with columns `view` and `<axis>_deg` of every axis.

    Raises CalibrationMissing that names file, line and column.
    """
    angles = [f"{name}_deg" for name in config.axis_names]
    return {
        Path(row["view"] or "").name: np.radians([number(row, c, where, "give degrees") for c in angles])
        for where, row in read_rows(path, ("view", *angles), f"view, {', '.join(angles)}")
    }
