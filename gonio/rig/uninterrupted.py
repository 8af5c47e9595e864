"""What makes a rig safe is not to be interrupted by an operator in a hurry."""

import contextlib
import signal
from collections.abc import Iterator


@contextlib.contextmanager
def uninterrupted() -> Iterator[None]:
    """Ctrl-C and SIGTERM have no effect inside; what is inside must end by itself. Outside the main thread: nothing."""
    try:
        before = {s: signal.signal(s, lambda *_: None) for s in (signal.SIGINT, signal.SIGTERM)}
    except ValueError:  # not in the main thread, where alone signals are handled
        before = {}
    try:
        yield
    finally:
        for s, handler in before.items():
            signal.signal(s, handler)
