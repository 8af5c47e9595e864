"""Any `Brdf` as a file that other programs read. One module per format, `write_X(brdf, path, ...)` in module X."""

import numpy as np

from gonio.geometry import Array


class ExportError(ValueError):
    """A BRDF that must not be written: says what is wrong with it. One line."""

    exit_code = 2


class ExportWarning(UserWarning):
    """What the file cannot hold of what was written to it, or what its readers must know. One line."""


def checked(brdf, wi: Array, wo: Array) -> Array:
    """`brdf.eval(wi, wo)`, (N, C), refused with ExportError where a value is NaN, infinite or negative.

    The programs that read these files check none of it.
    """
    f = brdf.eval(wi, wo)
    for wrong, word in ((~np.isfinite(f), "not finite"), (f < 0, "negative")):
        if wrong.any():
            row = int(np.flatnonzero(wrong.any(1))[0])
            theta_i, theta_o = (float(np.degrees(np.arctan2(np.hypot(w[0], w[1]), w[2]))) for w in (wi[row], wo[row]))
            raise ExportError(
                f"the BRDF is {word} at {wrong.any(1).sum()} of {len(f)} places, "
                f"the first at theta_i {theta_i:.1f}, theta_o {theta_o:.1f} degrees; nothing was written"
            )
    return f
