"""What a BRDF says of itself at given pairs, as columns: value, standard deviation, intervals."""

from collections.abc import Callable, Iterator

import numpy as np

from gonio.brdf import Brdf
from gonio.geometry import Array

Shared = Callable[[Array, Array], Array]  # relative uncertainty (N, C) at pairs that all readings have in common
LEVELS = (68, 90, 95, 99)


def columns(brdf: Brdf | None, wi: Array, wo: Array, shared: Shared | None = None) -> Iterator[tuple[str, Array]]:
    """brdf_*, std_*, low68_*, high68_*, … of pairs (..., 3), one of each channel (*), shaped (...); 1/sr, no cosine.

    shared, of a calibrated rig: u_shared_*, relative (k = 1), by which all may be off together; the rest is without it.
    Nothing of a BRDF that does not know its intervals; NaN where a direction is.
    """
    interval, std = getattr(brdf, "interval", None), getattr(brdf, "std", None)
    if brdf is None or interval is None or std is None:
        return
    shape, wi, wo = wi.shape[:-1], wi.reshape(-1, 3), wo.reshape(-1, 3)
    known = np.isfinite(np.concatenate([wi, wo], 1)).all(1)
    wi, wo = wi[known], wo[known]
    parts = {"brdf": brdf.eval(wi, wo), "std": std(wi, wo)}
    for level in LEVELS:
        parts[f"low{level}"], parts[f"high{level}"] = interval(wi, wo, level / 100)
    if shared is not None:
        parts["u_shared"] = shared(wi, wo)
    for name, values in parts.items():
        for c in range(brdf.channels):
            out = np.full(known.shape, np.nan)
            out[known] = values[:, c]
            yield f"{name}_{c}", out.reshape(shape)
