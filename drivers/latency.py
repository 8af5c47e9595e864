"""How long a USB serial adapter holds back what it received: the kernel's default of 16 ms makes every poll wait."""

from pathlib import Path

SLOW_MS = 4  # above which a poll of the servos is slow
SYS = Path("/sys/bus/usb-serial/devices")


def latency_ms(port: str) -> int | None:
    """The adapter's latency timer, None where it has none (as a pseudo-terminal or a USB modem has not)."""
    try:
        return int(_file(port).read_text())
    except (OSError, ValueError):
        return None


def too_slow(port: str) -> str | None:
    """What to tell of a timer that is too long, and the remedy; None where it is well."""
    ms = latency_ms(port)
    if ms is None or ms <= SLOW_MS:
        return None
    remedy = f"have it set to 1 (as root: echo 1 > {_file(port)}; for good, by the udev rule in docs/operator.md)"
    return f"USB latency timer is {ms} ms, each poll waits for it; {remedy}"


def _file(port: str) -> Path:
    return SYS / Path(port).resolve().name / "latency_timer"
