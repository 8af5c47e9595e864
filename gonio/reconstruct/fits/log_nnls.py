"""Non-negative least squares of logarithms."""

import numpy as np

from gonio.geometry import Array

STEPS = 4


def log_nnls(columns: Array, target: Array, floor: Array) -> Array:
    """x >= 0 (K,) for which log(columns @ x + floor) is nearest to log(target + floor) in the mean square.

    columns (N, K) >= 0, target (N,) >= 0, floor (N,) > 0. From a fit of the cube roots' weights, Gauss-Newton steps:
    each linearises the logarithm about the last fit, which plain relative weights (too dark by a half on rough
    surfaces) do not.
    """
    from scipy.optimize import nnls

    scale = np.maximum(columns.max(0), 1e-300)
    unit = columns / scale
    t = target + floor
    weight = t ** (-2 / 3)
    weight /= weight.max()
    x = nnls(unit * weight[:, None], target * weight)[0]
    best, least = x, np.inf
    for _ in range(STEPS):
        fitted = unit @ x + floor
        residual = np.log(t / fitted)
        loss = float(residual @ residual)
        if loss < least:
            best, least = x, loss
        wanted = fitted * (1 + np.clip(residual, -3, 3)) - floor
        weight = 1 / fitted
        weight /= weight.max()
        x = nnls(unit * weight[:, None], wanted * weight)[0]
    residual = np.log(t / (unit @ x + floor))
    return (x if residual @ residual < least else best) / scale
