"""A printed board in the sample's place, for a simulated camera to look at: lies askew, and lit all over."""

import numpy as np
from numpy.typing import NDArray

from gonio.brdf.models.lambert import Lambert
from gonio.geometry import Array

PAPER, INK = 0.9, 0.05  # albedo
MARGIN = 0.15  # of the board's longer side, white paper round it


class BoardOnPlate(Lambert):
    """A white diffuser with a picture (H, W), 8-bit grey, printed on it, `width` metres across.

    askew: turned about the normal, rad, and its middle (2,) beside the sample's, metres.
    """

    def __init__(
        self,
        picture: NDArray[np.uint8],
        width: float,
        channels: int,
        askew: tuple[float, tuple[float, float]] = (0.05, (0.0005, -0.0004)),
    ):
        super().__init__(np.full(channels, PAPER))
        self.picture, self.width, self.askew = picture, width, askew

    def texture(self, x: Array, y: Array, blur: float) -> Array:
        """Albedo in relation to paper at points of the plate, metres; NaN where they are. blur: metres a pixel sees."""
        import cv2

        h, w = self.picture.shape
        scale = w / self.width
        angle, (x0, y0) = self.askew
        c, s = np.cos(angle), np.sin(angle)
        across, up = c * (x - x0) + s * (y - y0), c * (y - y0) - s * (x - x0)
        column, row = scale * across + w / 2 - 0.5, h / 2 - 0.5 - scale * up
        grey = INK / PAPER + (1 - INK / PAPER) * self.picture.astype(np.float32) / 255
        soft = cv2.GaussianBlur(grey, (0, 0), max(0.5 * blur * scale, 0.3))
        seen = cv2.remap(
            soft,
            column.astype(np.float32),
            row.astype(np.float32),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=1,
        )
        reach = (0.5 + MARGIN) * max(w, h) / scale
        lies = np.maximum(np.abs(across), np.abs(up)) < reach
        return np.where(np.isfinite(x) & np.isfinite(y), np.where(lies, seen, 0.1), np.nan)
