"""Pictures of a board by the rig's own camera, at poses chosen where they tell most of its mount (D-optimal)."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from calibration.board import Board
from calibration.take_view import take_view
from gonio.geometry import Array
from gonio.rig.build import geometry_calibration, park_pose, view_of
from gonio.rig.errors import CalibrationMissing, SafetyStop
from gonio.rig.signal.view import View, rotation_of
from gonio.rig.staged import StagedRig

CANDIDATES, STEEPEST = 400, 50.0  # poses; degrees from the normal at which a board is looked at
RIM = 0.04  # of the picture, that a board keeps clear of: its camera need not look where it was drawn
STEP = 1e-6
PRIOR = np.array([0.1, 0.1, 0.1, 0.02, 0.02, 0.02] * 2)  # rad and metres: mount, and how the board lies


def take_views(
    rig: StagedRig, board: Board, count: int, folder: Path, say: Callable[[str], None]
) -> tuple[list[Path], Path]:
    """`count` pictures in a new folder and the table of their poses there. The light is off afterwards.

    Raises CalibrationMissing where the folder has pictures already, or the board fits into no picture; SafetyStop.
    """
    if rig.config.detector != "camera":
        raise CalibrationMissing(f"rig {rig.config.name}: its detector is a photodiode, which takes no pictures")
    table = folder / "poses.csv"
    if table.exists() or (folder.is_dir() and any(folder.glob("view*.png"))):
        raise CalibrationMissing(f"{folder}: has views already; name another folder with --views")
    view = view_of(rig.config, geometry_calibration(rig.config))
    poses = _showing(rig, view, board)
    if len(poses) < count:
        raise CalibrationMissing(
            f"camera: the board fits into the picture at {len(poses)} poses of {CANDIDATES} only; print a smaller one"
        )
    chosen = _telling(poses, view, board, count)
    folder.mkdir(parents=True, exist_ok=True)
    taken: list[Path] = []
    while len(chosen):
        k = int(np.abs(chosen - rig.stage.pose()).max(1).argmin())
        at = rig.driver.go(chosen[k])
        chosen = np.delete(chosen, k, 0)
        if rig.driver.stopped.is_set():
            raise KeyboardInterrupt
        if at is None:
            continue
        rig.clock.sleep(rig.config.settle_s)
        rig.announce(-(1 << 45) - len(taken))
        taken.append(folder / f"view{len(taken) + 1:02}.png")
        take_view(rig, taken[-1], table)
        say(f"view {len(taken)} of {count}")
    if not taken:
        raise SafetyStop(f"rig {rig.config.name}: no clear way to any pose that shows the board; park it and try again")
    return taken, table


def _showing(rig: StagedRig, view: View, board: Board) -> Array:
    """Random poses within the envelope at which the whole board lies in the picture; the light stays where it rests."""
    e, rng = rig.envelope, np.random.default_rng(0)
    poses = rng.uniform(np.maximum(e.lower, -np.pi / 2), np.minimum(e.upper, np.pi / 2), (50 * CANDIDATES, len(e.axes)))
    if "light" in rig.config.axis_names:
        k = rig.config.axis_names.index("light")
        poses[:, k] = park_pose(rig.config)[k]
    poses = e.snap(poses)
    wi, wo = e.kinematics.forward(poses)
    good = (wo[:, 2] > np.cos(np.radians(STEEPEST))) & (wi[:, 2] > 0.2) & e.inside(poses)
    good &= e.separation(poses) > e.stay_out + np.radians(2)
    poses = poses[good][:CANDIDATES]
    size, rim = np.array(view.size), RIM * np.array(view.size)
    pixels = np.array([view.project(_corners(board), p) for p in poses]).reshape(len(poses), -1, 2)
    with np.errstate(invalid="ignore"):
        inside = ((pixels > rim) & (pixels < size - 1 - rim)).all((1, 2))
    return poses[inside]


def _telling(poses: Array, view: View, board: Board, count: int) -> Array:
    """Greedy: each pose the one that shrinks the covariance of mount and board most, in pixels of noise 0.3."""
    told = np.diag(PRIOR**-2)
    slopes = [_slopes(view, board, p) / 0.3 for p in poses]
    left = list(range(len(poses)))
    chosen = []
    for _ in range(count):
        c = np.linalg.inv(told)
        gain = [np.linalg.slogdet(np.eye(len(j)) + j @ c @ j.T)[1] for j in (slopes[k] for k in left)]
        chosen.append(left.pop(int(np.argmax(gain))))
        told = told + slopes[chosen[-1]].T @ slopes[chosen[-1]]
    return poses[chosen]


def _slopes(view: View, board: Board, pose: Array) -> Array:
    """d(pixels of the board's corners) / d(mount, board's lie): (8, 12), by differences."""
    corners = _corners(board)

    def pixels(p: Array) -> Array:
        turned = rotation_of(p[:3]) @ view.rotation
        moved = View(view.matrix, view.distortion, view.size, turned, view.translation + p[3:6], view.arm)
        return moved.project(corners @ rotation_of(p[6:9]).T + p[9:], pose).ravel()

    return np.stack([(pixels(s) - pixels(-s)) / (2 * STEP) for s in STEP * np.eye(12)], 1)


def _corners(board: Board) -> Array:
    """Its four corners (4, 3) where it lies as it should, metres."""
    x, y = board.across * board.square / 2, board.down * board.square / 2
    return np.array([[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0]])
