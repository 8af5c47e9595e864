"""Linear sRGB reflectances as smooth spectra (after Mallett and Yuksel 2019): three basis curves that add to 1.

Light of a 6504 K radiator on the spectrum gives the rgb back, on the CIE 1931 curves as fitted by Wyman et al. 2013.
"""

from functools import lru_cache

import numpy as np

from gonio.geometry import Array

WAVELENGTHS = np.arange(380.0, 731.0, 10.0)
XYZ_TO_RGB = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])


@lru_cache(1)
def upsample() -> Array:
    """(W, 3), within 0..1: spectrum at WAVELENGTHS = upsample() @ rgb."""
    from scipy.optimize import lsq_linear

    response = rgb_response()
    n = len(WAVELENGTHS)
    eye = np.eye(n)
    slope = 0.05 * (eye[1:] - eye[:-1])
    rows = [np.kron(np.eye(3), slope), 1e3 * np.kron(np.eye(3), response), 1e3 * np.hstack([eye, eye, eye])]
    right = np.concatenate([np.zeros(3 * (n - 1)), 1e3 * np.eye(3).ravel(), 1e3 * np.ones(n)])
    return lsq_linear(np.vstack(rows), right, bounds=(0, 1)).x.reshape(3, n).T


def rgb_response() -> Array:
    """(3, W): rgb of a reflectance spectrum under the light; a white one gives 1, 1, 1."""
    power = WAVELENGTHS**-5.0 / np.expm1(1.4388e7 / (WAVELENGTHS * 6504))
    response = XYZ_TO_RGB @ (_cie1931() * power)
    return response / response.sum(1, keepdims=True)


def _cie1931() -> Array:
    def bump(mean: float, below: float, above: float) -> Array:
        t = (WAVELENGTHS - mean) * np.where(mean > WAVELENGTHS, below, above)
        return np.exp(-0.5 * t * t)

    x = 0.362 * bump(442.0, 0.0624, 0.0374) + 1.056 * bump(599.8, 0.0264, 0.0323) - 0.065 * bump(501.1, 0.0490, 0.0382)
    y = 0.821 * bump(568.8, 0.0213, 0.0247) + 0.286 * bump(530.9, 0.0613, 0.0322)
    z = 1.217 * bump(437.0, 0.0845, 0.0278) + 0.681 * bump(459.0, 0.0385, 0.0725)
    return np.stack([x, y, z])
