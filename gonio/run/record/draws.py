"""What of a run was drawn with a known density, block by block, as integrals take it."""

import numpy as np

from gonio.mcmc.proposals import DRAWN, INDEPENDENCE
from gonio.reconstruct.integrals import Draws
from gonio.run.record.store import Measured, Store

FIRST_BLOCK = 200  # measurements; a chain that draws a few at a time is read in blocks that double


def load_draws(store: Store, m: Measured) -> Draws:
    """Rows count the measurements of `m` that gave a value, as `load_samples` gives them."""
    s = store.steps()
    usable = np.isfinite(m.f).all(1)
    row_of = np.where(usable, np.cumsum(usable) - 1, -1)
    measured = s["id"] >= 0
    have = np.zeros(len(measured), bool)
    at = np.searchsorted(m.id, s["id"][measured])
    have[measured] = (at < len(m.id)) & (m.id[np.minimum(at, len(m.id) - 1)] == s["id"][measured])
    designed = (s["kind"] == DRAWN).any()
    drawn = np.isin(s["kind"], (INDEPENDENCE, DRAWN)) & np.isfinite(s["log_q"])
    # a free step of an independence chain is a draw that fell where f is 0; an empty slot of a block is no draw
    drawn &= have | (~measured & (not designed))
    row = np.full(len(measured), -1)
    row[have] = row_of[np.searchsorted(m.id, s["id"][have])]
    if designed:
        block = np.where(s["step"] >= 0, s["step"] + 1, s["chain"])
    else:
        block = _doubling(s, measured)
    drawn &= block >= 1
    directions = s["proposed"].copy()
    directions[have] = m.asked[np.searchsorted(m.id, s["id"][have])]
    return Draws(block[drawn], row[drawn], directions[drawn, :3], directions[drawn, 3:], s["log_q"][drawn])


def _doubling(s, measured):
    """Block of each step by the measurement it is or follows: 1 from FIRST_BLOCK on, then at every doubling."""
    order = np.lexsort((s["chain"], s["step"]))
    last = np.empty(len(measured), np.int64)
    last[order] = np.maximum.accumulate(np.where(measured, s["id"], -1)[order])
    return np.where(last < FIRST_BLOCK, 0, np.floor(np.log2(np.maximum(last, 1) / FIRST_BLOCK)).astype(int) + 1)
