"""Random numbers that belong to a measurement, not to its place in the order: counter-based (Philox, Salmon 2011)."""

import numpy as np

STAGE, PHOTODIODE, CAMERA, WORLD = range(4)  # streams: no two devices share one


def generator(seed: int, stream: int, number: int, *place: int) -> np.random.Generator:
    """The generator of measurement `number` (negative for what is not one, as dark readings) on one device.

    place: up to two numbers more, for what is drawn in several parts that may come in any order.
    """
    key = np.array([(seed ^ stream << 56) & 0xFFFFFFFFFFFFFFFF, number & 0xFFFFFFFFFFFFFFFF], np.uint64)
    counter = np.array([0, 0, *place, *[0] * (2 - len(place))], np.uint64)
    return np.random.Generator(np.random.Philox(key=key, counter=counter))
