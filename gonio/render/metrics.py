"""How different two rendered images are: figures that agree with what people see, each from a well-kept library."""

import numpy as np

from gonio.export.extra import needs
from gonio.geometry import Array
from gonio.render.shade import psnr, to_srgb


def compare(image: Array, reference: Array) -> dict[str, float]:
    """relMSE and PSNR of linear RGB, SSIM and FLIP of sRGB, mean dE_ITP (BT.2124). Images (H, W, 3), linear.

    PSNR is of values clipped to [0, 1]. Raises MissingExtra without the `render` extra.
    """
    similarity = needs("skimage.metrics", "render").structural_similarity
    flip = needs("flip_evaluator", "render")
    colour = needs("colour", "render")
    shown, wanted = to_srgb(image), to_srgb(reference)
    rel = np.mean((image - reference) ** 2 / (reference**2 + 1e-2))
    flip_mean = flip.evaluate(wanted.astype(np.float32), shown.astype(np.float32), "LDR")[1]
    return {
        "relMSE": float(rel),
        "PSNR": psnr(image, reference),
        "SSIM": float(similarity(wanted, shown, channel_axis=-1, data_range=1.0)),
        "FLIP": float(flip_mean),
        "dE_ITP": float(np.mean(colour.difference.delta_E_ITP(_ictcp(colour, image), _ictcp(colour, reference)))),
    }


def _ictcp(colour, image: Array) -> Array:
    """ICtCp of linear sRGB shown at 100 cd/m2 white."""
    bt2020 = colour.RGB_to_RGB(np.clip(image, 0, 1), "sRGB", "ITU-R BT.2020")
    return colour.RGB_to_ICtCp(np.clip(bt2020, 0, None) * 100)
