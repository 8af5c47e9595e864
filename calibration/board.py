"""ChArUco boards: made, found in pictures, and told apart.

A board of an even count of squares down begins with another corner since OpenCV 4.6; older ones are "legacy". A picture
of one kind, or of a board with its sides swapped, is found with ids that look right and are not: its corners do not lie
on a plane then, and that is how it is known.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gonio.geometry import Array

Image = NDArray[np.uint8]
FEWEST_CORNERS = 8
FLAT = 0.06  # of a square's side: how far off a plane corners of the right board lie, the lens's distortion included
ON_A_PLANE = 0.3  # share of corners that do at least, however bent the lens
FEWEST_MARKERS, LOOKED_AT = 4, 3  # in so many views, to be no chance
CLEARLY = 1.5  # times the corners of the board that was named: what another has to show to be believed


@dataclass(frozen=True)
class Board:
    """Squares across and down, their side and that of the markers in metres, an ArUco dictionary's name.

    Raises ValueError for a dictionary that OpenCV does not know, or with fewer markers than the board has.
    """

    across: int = 7
    down: int = 5
    square: float = 0.03
    marker: float = 0.022
    dictionary: str = "DICT_4X4_50"
    legacy: bool = False

    def __post_init__(self) -> None:
        if min(self.across, self.down) < 2 or self.across * self.down < 6:
            raise ValueError(f"board of {self.across} x {self.down}: it has at least 2 x 3 squares")
        if not 0 < self.marker < self.square:
            raise ValueError("board: the markers are smaller than the squares they lie in")
        if self.dictionary not in dictionaries():
            raise ValueError(f"dictionary {self.dictionary}: not one of {', '.join(dictionaries())}")
        held = _held(self.dictionary)
        if held < self.across * self.down // 2:
            raise ValueError(
                f"dictionary {self.dictionary}: has {held} markers, {self.across * self.down // 2} are needed"
            )

    def charuco(self) -> Any:
        from cv2 import aruco

        dictionary = aruco.getPredefinedDictionary(getattr(aruco, self.dictionary))
        board = aruco.CharucoBoard((self.across, self.down), self.square, self.marker, dictionary)
        board.setLegacyPattern(self.legacy)
        return board

    def __str__(self) -> str:
        return f"{self.across} x {self.down} squares, {'legacy' if self.legacy else 'new'} pattern"


def dictionaries() -> list[str]:
    """The names of OpenCV's ArUco dictionaries."""
    from cv2 import aruco

    return sorted(name for name in dir(aruco) if name.startswith("DICT_"))


def board_image(board: Board, pixels_per_square: int = 120) -> Image:
    """The board to print, 8-bit grey, without margin."""
    return board.charuco().generateImage((board.across * pixels_per_square, board.down * pixels_per_square))


@dataclass(frozen=True)
class Corners:
    """Corners of the board that one view shows: (N, 3) metres on the board, (N, 2) pixels."""

    on_board: Array
    in_view: Array


def find_corners(views: Sequence[Image], board: Board) -> list[Corners | None]:
    """Of each grey view (H, W); None where it shows too few of them."""
    import cv2

    charuco = board.charuco()
    detector = cv2.aruco.CharucoDetector(charuco)
    found: list[Corners | None] = []
    for view in views:
        corners, ids, _, _ = detector.detectBoard(view)
        if ids is None or len(ids) < FEWEST_CORNERS:
            found.append(None)
            continue
        on_board, in_view = charuco.matchImagePoints(corners, ids)
        found.append(Corners(np.asarray(on_board, np.float32).reshape(-1, 3), np.asarray(in_view).reshape(-1, 2)))
    return found


def recognised(views: Sequence[Image], board: Board) -> Board:
    """The board that the views show: `board`, or its other pattern, or with its sides swapped; by which of them the
    most corners lie on a plane."""
    kinds = [board, replace(board, legacy=not board.legacy)]
    kinds += [replace(b, across=b.down, down=b.across) for b in kinds]
    flat = {b: sum(flat_corners(c, b) for c in find_corners(views, b)) for b in dict.fromkeys(kinds)}
    best = max(flat, key=lambda b: flat[b])
    return best if flat[best] > CLEARLY * flat[board] else board


def contradiction(views: Sequence[Image], board: Board, corners: Sequence[Corners | None]) -> str:
    """What the views say against the board that they should show, in words; "" for nothing."""
    found = sum(len(c.on_board) for c in corners if c is not None)
    squares = f"a board of {board.across} x {board.down} squares, in either pattern and with its sides swapped"
    advice = "count its squares and name them by --across and --down"
    if found:
        flat = sum(flat_corners(c, board) for c in corners)
        return "" if flat > ON_A_PLANE * found else f"the corners do not lie as on {squares}; {advice}"
    if _markers(views, board.dictionary) >= FEWEST_MARKERS:
        return f"markers of {board.dictionary} are seen, but not as on {squares}; {advice}"
    families: dict[str, list[str]] = {}  # DICT_4X4_50 are the first markers of DICT_4X4_100, and so on
    for name in sorted(dictionaries(), key=_held):
        families.setdefault(name.rpartition("_")[0] if "X" in name else name, []).append(name)
    family = max(families.values(), key=lambda names: _markers(views, names[-1]))
    if (most := _markers(views, family[-1])) < FEWEST_MARKERS:
        return ""  # of nothing that is known
    best = next(name for name in family if _markers(views, name) >= most)
    return f"no markers of {board.dictionary} are seen, but of {best}; call it --dictionary {best}"


def _markers(views: Sequence[Image], dictionary: str) -> int:
    from cv2 import aruco

    detector = aruco.ArucoDetector(aruco.getPredefinedDictionary(getattr(aruco, dictionary)))
    return sum(len(detector.detectMarkers(view)[0]) for view in views[:LOOKED_AT])


def _held(dictionary: str) -> int:
    from cv2 import aruco

    return len(aruco.getPredefinedDictionary(getattr(aruco, dictionary)).bytesList)


def flat_corners(corners: Corners | None, board: Board) -> int:
    """How many corners of a view lie where a plane board would have them."""
    import cv2

    if corners is None:
        return 0
    plane = corners.on_board[:, :2].astype(np.float64)
    view = corners.in_view.astype(np.float64)
    found, _ = cv2.findHomography(plane, view, 0)
    if found is None:
        return 0
    seen = cv2.perspectiveTransform(plane[:, None], found)[:, 0]
    aside = cv2.perspectiveTransform(plane[:, None] + [[board.square, 0.0]], found)[:, 0]
    side = np.linalg.norm(aside - seen, axis=1)
    return int((np.linalg.norm(seen - view, axis=1) < FLAT * side).sum())
