"""Random numbers that belong to a measurement, not to its place in the order: counter-based (Philox, Salmon 2011)."""

import numpy as np

STAGE, PHOTODIODE, CAMERA = range(3)  # streams: no two devices share one


def generator(seed: int, stream: int, number: int) -> np.random.Generator:
    """The generator of measurement `number` (negative for what is not one, as dark readings) on one device."""
    key = (seed ^ stream << 56) & 0xFFFFFFFFFFFFFFFF
    return np.random.Generator(np.random.Philox(key=np.array([key, number & 0xFFFFFFFFFFFFFFFF], np.uint64)))
