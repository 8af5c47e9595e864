"""Numbers as instruments write them: plain decimals, and nothing that Python would take for one besides."""

import re

DECIMAL = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?", re.ASCII)
WHOLE = re.compile(r"\d{1,12}")


def decimal(text: str) -> float:
    """NR1, NR2 or NR3 of IEEE 488.2. Raises ValueError for anything else: 1_000, nan, inf, 0x1F, an empty text."""
    if not DECIMAL.fullmatch(text.strip()):
        raise ValueError(f"{text!r} is not a number")
    return float(text)


def whole(text: str) -> int:
    """A number that counts something. Raises ValueError for anything but ASCII digits."""
    if not (text.isascii() and WHOLE.fullmatch(text)):
        raise ValueError(f"{text!r} is not a whole number")
    return int(text)
