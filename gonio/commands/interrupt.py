"""Ctrl-C once: finish this measurement, store it, leave. Twice: stop now. More often: nothing can hold up the stop."""

import signal
import sys


class Interrupt:
    """Within `with`, a callable: did the operator ask to stop? A second Ctrl-C raises KeyboardInterrupt, once only:
    what is done about it, motors first, is not to be interrupted itself."""

    def __init__(self, asked: bool = False) -> None:
        self._asked = asked
        self._raised = False

    @classmethod
    def at_once(cls) -> "Interrupt":
        """For what has no safe point to wait for: the first Ctrl-C raises."""
        return cls(asked=True)

    def __enter__(self) -> "Interrupt":
        try:
            self._before = {s: signal.signal(s, self._on_signal) for s in (signal.SIGINT, signal.SIGTERM)}
        except ValueError:  # not in the main thread: whoever is, handles signals
            self._before = {}
        return self

    def __exit__(self, *exc) -> None:
        for s, handler in self._before.items():
            signal.signal(s, handler)

    def __call__(self) -> bool:
        return self._asked

    def _on_signal(self, number, frame) -> None:
        if self._raised:
            return
        if self._asked:
            self._raised = True
            raise KeyboardInterrupt
        self._asked = True
        print("\nstopping after this measurement; once more to stop now", file=sys.stderr, flush=True)
