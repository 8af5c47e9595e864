"""What a run measured, as a reconstruction takes it."""

import numpy as np

from gonio.reconstruct.samples import Samples
from gonio.run.record.store import Measured, Store


def load_samples(store: Store, measured: Measured | None = None) -> Samples:
    """All measurements of a run that gave a value, as a reconstruction takes them."""
    m = store.measured() if measured is None else measured
    good = np.isfinite(m.f).all(1) if len(m.id) else np.zeros(0, bool)
    return Samples.of(m.seen[good, :3], m.seen[good, 3:], m.f[good], m.sigma[good], m.saturated[good])
