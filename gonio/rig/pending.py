"""The rest of a tour under way, as text: what a resumed run goes on with. 12 kB for 512 poses."""

import base64
import json
import zlib

import numpy as np

from gonio.geometry import Array

Pending = tuple[list[int], Array]  # ids of measurements still to come, and their poses (M, A)


def pack(pending: Pending) -> str:
    """Text of it; empty where nothing is to come."""
    numbers, poses = pending
    if not numbers:
        return ""
    return base64.b64encode(
        zlib.compress(json.dumps(numbers).encode() + b"\n" + np.asarray(poses).tobytes(), 1)
    ).decode()


def unpack(text: str, axes: int) -> Pending:
    """The inverse of `pack`, for a rig of so many axes."""
    if not text:
        return [], np.empty((0, axes))
    head, _, body = zlib.decompress(base64.b64decode(text)).partition(b"\n")
    return json.loads(head), np.frombuffer(body, float).reshape(-1, axes).copy()
