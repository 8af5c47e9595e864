"""Names of columns, taken apart from the unit that they end with."""

import re

ANGLES = {"deg": "degrees", "degree": "degrees", "degrees": "degrees", "°": "degrees", "rad": "radians",
          "radian": "radians", "radians": "radians"}  # fmt: skip
_BRACKET = re.compile(r"[\[(]\s*([^\])]*?)\s*[\])]+\s*$")


def split(name: str) -> tuple[str, str]:
    """(name without its unit, lower case; degrees, radians or "")."""
    text = name.strip().lower()
    if found := _BRACKET.search(text):
        return text[: found.start()].strip(), ANGLES.get(found[1], "")
    head, _, tail = text.rpartition("_")
    return (head, ANGLES[tail]) if head and tail in ANGLES else (text, "")


def bracket(name: str) -> str:
    """What stands in brackets at the end of a name, "" where nothing does."""
    found = _BRACKET.search(name)
    return found[1].strip() if found else ""
