"""The progress line: a live one on a terminal, one line in five seconds in a log."""

import sys
import time

from gonio.acquire import Progress


class ProgressLine:
    def __init__(self, stream=None, interval_s: float | None = None):
        self._stream = stream or sys.stderr
        self._live = self._stream.isatty()
        self._interval = interval_s if interval_s is not None else (0.1 if self._live else 5.0)
        self._last = 0.0
        self._shown: Progress | None = None

    def __enter__(self) -> "ProgressLine":
        return self

    def __exit__(self, *exc) -> None:
        if self._shown is not None:
            self._write(self._shown, end="\n")

    def update(self, progress: Progress) -> None:
        self._shown = progress
        now = time.monotonic()
        if now - self._last >= self._interval:
            self._last = now
            self._write(progress, end="" if self._live else "\n")

    def _write(self, p: Progress, end: str) -> None:
        self._stream.write(("\r\x1b[K" if self._live else "") + progress_text(p) + end)
        self._stream.flush()


def progress_text(p: Progress) -> str:
    """measured / free, acceptance, rig time, ETA in one line."""
    of = f"/{p.budget}" if p.budget else ""
    eta = p.eta_s()
    parts = [
        f"measured {p.measured}{of}",
        f"free {p.free}",
        f"acceptance {p.acceptance:.0%}",
        f"rig {duration(p.rig_s)}",
        f"ETA {duration(eta) if eta is not None else '–'}",
    ]
    if p.energy_error is not None:
        parts.append(f"error ~{p.energy_error:.3f}")
    return "  ".join(parts)


def duration(seconds: float) -> str:
    s = round(seconds)
    if s < 60:
        return f"{s} s"
    return f"{s // 60}:{s % 60:02d} min" if s < 3600 else f"{s // 3600}:{s % 3600 // 60:02d} h"
