"""The tour under way and how much of it is done: what a resumed run goes on with."""

import base64
import json
import zlib
from functools import cached_property

import numpy as np

from gonio.geometry import Array


class Pending:
    """ids of a tour's measurements and their poses (M, A), in the order of their visit; `done` of them are made."""

    def __init__(self, ids: list[int], poses: Array, done: int = 0):
        self.ids, self.poses, self.done = ids, poses, done

    @classmethod
    def none(cls, axes: int) -> "Pending":
        return cls([], np.empty((0, axes)))

    def left(self) -> tuple[list[int], Array]:
        """ids and poses still to come."""
        return self.ids[self.done :], self.poses[self.done :]

    @cached_property
    def text(self) -> str:
        """The tour as text, the same for as long as it lasts; 12 kB for 512 poses, empty where there is none."""
        if not self.ids:
            return ""
        packed = zlib.compress(json.dumps(self.ids).encode() + b"\n" + np.asarray(self.poses).tobytes(), 1)
        return base64.b64encode(packed).decode()

    @classmethod
    def of_text(cls, text: str, done: int, axes: int) -> "Pending":
        """The inverse of `text`, for a rig of so many axes."""
        if not text:
            return cls.none(axes)
        head, _, body = zlib.decompress(base64.b64decode(text)).partition(b"\n")
        return cls(json.loads(head), np.frombuffer(body, float).reshape(-1, axes).copy(), done)
