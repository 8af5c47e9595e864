"""Text of files that nobody vouches for: bounded, decoded, its numbers found or refused with their line."""

import os
import warnings
from pathlib import Path

import numpy as np

from gonio.geometry import Array
from gonio.importing import CannotImport

MOST_BYTES = 60_000_000  # of a text file; one reading a line of 100 bytes is 600,000 readings
MOST_LINES = 1_500_000
LONGEST_LINE = 2_000_000  # characters
MOST_CHANNELS = 512


def read_bytes(path: Path, most: int = MOST_BYTES) -> bytes:
    """Raises CannotImport for what is no readable file, or larger than `most`."""
    try:
        if not path.is_file():
            raise CannotImport(
                f"{path}: {'not a file' if path.exists() else 'does not exist'}; name a file of readings"
            )
        if (size := os.path.getsize(path)) > most:
            raise CannotImport(f"{path}: {size} bytes, {most} is the most that is read; split it")
        return path.read_bytes()
    except OSError as e:
        raise CannotImport(f"{path}: {e.strerror or e}; name a file of readings") from None


def read_lines(path: Path) -> list[str]:
    """The lines of a text, none of them out of measure. Raises CannotImport as `read_text`."""
    text = read_text(path)
    if (n := text.count("\n")) > MOST_LINES:
        raise CannotImport(f"{path}: {n} lines, {MOST_LINES} are the most; split it")
    lines = text.split("\n")
    longest = max(range(len(lines)), key=lambda k: len(lines[k]))
    if len(lines[longest]) > LONGEST_LINE:
        raise CannotImport(f"{path}:{longest + 1}: a line of {len(lines[longest])} characters is no row of readings")
    return lines


def read_text(path: Path, most: int = MOST_BYTES) -> str:
    """UTF-8, or Latin-1 as older instruments write degree signs in; line ends become newlines."""
    data = read_bytes(path, most)
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise CannotImport(f"{path}: byte 0: UTF-16 text; save it as UTF-8")
    if (nul := data.find(b"\0")) >= 0:
        raise CannotImport(f"{path}: byte {nul}: a zero byte, so not text; name its kind by --format if it is another")
    if not data.strip():
        raise CannotImport(f"{path}: empty")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def numbers(lines: list[str], name: str, first: int) -> Array:
    """All numbers of lines, separated by white space. first: the line's number (from 1) of lines[0] in the file.

    Raises CannotImport with the line of what is no number.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return np.fromstring("\n".join(lines), sep=" ") if lines else np.empty(0)
        except (DeprecationWarning, ValueError):
            pass
    for k, line in enumerate(lines):
        for word in line.split():
            number(word, f"{name}:{first + k}")
    raise CannotImport(f"{name}:{first}: numbers expected")


def number(word: str, where: str) -> float:
    """One number. Raises CannotImport, which begins with `where`."""
    try:
        return float(word)
    except ValueError:
        raise CannotImport(f"{where}: {word[:40]!r} where a number is expected") from None


def count(word: str, where: str, most: int) -> int:
    """A count that a file gives of what follows: 1 to `most`."""
    value = number(word, where)
    if not (1 <= value <= most and value == int(value)):
        raise CannotImport(f"{where}: a count of {word[:40]}, 1 to {most} expected")
    return int(value)


def channel_names(count: int) -> tuple[str, ...]:
    """Names of channels that a file does not name."""
    return ("R", "G", "B") if count == 3 else ("Y",) if count == 1 else tuple(f"c{i}" for i in range(count))
