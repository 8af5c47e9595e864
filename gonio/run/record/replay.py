"""A chain is its seed and its answers: told the stored ones again, a fresh sampler is the chain it was."""

import numpy as np

from gonio.mcmc.ask_tell import AskTell
from gonio.mcmc.chain.steps import Steps
from gonio.run.record.folder import StoreError
from gonio.run.record.schema import Measured
from gonio.run.record.store import Store

ROUNDING = 1e-9


def replay(sampler: AskTell, store: Store) -> tuple[Measured, Steps]:
    """Tell a fresh sampler all that is stored, so that it goes on as if it had never been stopped.

    What was measured, and the steps made of it. Every stored direction is compared with what the sampler asks. Raises
    StoreError where they differ by more than the rounding of another processor's sines.
    """
    known = store.measured()
    while len(known.id):
        batch = sampler.ask()
        row = np.searchsorted(known.id, batch.ids)
        have = row < len(known.id)
        have[have] = known.id[row[have]] == batch.ids[have]
        if not have.any():
            break
        row = row[have]
        asked = np.concatenate([batch.wi, batch.wo], 1)[have]
        if not np.allclose(known.asked[row], asked, rtol=0, atol=ROUNDING):
            raise StoreError(
                f"{store.folder}: its chain cannot be continued by this version of gonio; use the one in its provenance"
            )
        sampler.tell(batch.ids[have], known.f[row], known.sigma[row])
        if not have.all():
            break
    steps = sampler.take_steps()
    store.add_steps(steps)
    return known, steps
