"""What a YAML file may say of an instrument that speaks plain text, and of such a one as a rig's detector.

docs/instruments.md walks through it; `configs/instruments/` has the descriptions that ship.
"""

import re
import string
import warnings
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, field_validator, model_validator

from gonio.config.bands import MOST_PIXELS, Bands
from gonio.config.find import find_config
from gonio.config.loader import Section, load_config
from gonio.config.plugins import DetectorSection

MOST_VALUES = MOST_PIXELS  # that one answer may hold
UNIT = re.compile(r"[A-Za-z][A-Za-z0-9/^]{0,15}")
PREFIXES = {"f": 1e-15, "p": 1e-12, "n": 1e-9, "u": 1e-6, "µ": 1e-6, "μ": 1e-6, "m": 1e-3, "": 1.0, "k": 1e3, "M": 1e6}
LONGEST = 1000  # characters of a pattern or a command


def _pattern(text: str) -> str:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # what Python will understand otherwise one day
            re.compile(text)
    except (re.error, OverflowError, RecursionError, Warning) as e:
        raise ValueError(f"not a regular expression: {e}") from None
    return text


def _line(text: str) -> str:
    if not text.isascii() or any(ord(c) < 32 for c in text):
        raise ValueError("one line of ASCII; `line_end` is sent behind it")
    return text


Pattern = Annotated[str, Field(min_length=1, max_length=LONGEST), AfterValidator(_pattern)]
Line = Annotated[str, Field(max_length=LONGEST), AfterValidator(_line)]
Command = Annotated[Line, Field(min_length=1)]
Positive = Annotated[float, Field(gt=0)]


def filled(template: str, **values: float) -> str:
    """A command with numbers put in: `{index:.0f}`. Raises ValueError for a name that is not one of `values`."""
    for _, name, spec, conversion in string.Formatter().parse(template):
        if (name is not None and name not in values) or conversion or "{" in (spec or ""):
            raise ValueError(f"{{{name}}} is not known here; there is {', '.join('{' + v + '}' for v in values)}")
    return template.format(**values)


def as_sent(template: str, value: float) -> float:
    """What a number is once it is written by the {value} of a template: 0.125 by {value:.2f} is 0.12."""
    spec = next(s for _, name, s, _ in string.Formatter().parse(template) if name == "value")
    return float(format(value, spec or ""))


def factor_of(unit: str, base: str) -> float:
    """How many `base` one `unit` is: nA -> A 1e-9. Raises ValueError where they are not of one kind."""
    theirs, ours = _parts(unit), _parts(base)
    for of_unit, stem in theirs:
        for of_base, other in ours:
            if stem == other:
                return of_unit / of_base
    raise ValueError(f"{unit!r} is no unit of {base}")


def _parts(unit: str) -> list[tuple[float, str]]:
    """Readings of a unit as a prefix and the rest; without a prefix first."""
    found = [(1.0, unit)]
    if len(unit) > 1 and unit[0] in PREFIXES:
        found.append((PREFIXES[unit[0]], unit[1:]))
    return found


class SerialLine(Section):
    """How bytes go over a serial port."""

    baud: int = Field(9600, ge=50, le=10_000_000)
    bits: Literal[7, 8] = 8
    parity: Literal["none", "even", "odd"] = "none"
    stop_bits: Literal[1, 2] = 1
    flow: Literal["none", "xon", "rts"] = "none"


class Question(Section):
    """Something that is asked, and what an answer looks like."""

    ask: Command
    answer: Pattern = Field(description="regular expression of the whole answer")


class ErrorQuery(Question):
    """Asked after commands: `answer` has a group `code`, and may have `text`."""

    none: str = Field("0", description="the code that means no error")

    @model_validator(mode="after")
    def _code(self) -> "ErrorQuery":
        if "code" not in re.compile(self.answer).groupindex:
            raise ValueError("answer: needs a group (?P<code>...)")
        return self


class Ranges(Section):
    """The ladder of ranges, in the description's unit, lowest first; `command` has {full_scale} or {index}."""

    full_scale: tuple[Positive, ...] = Field(min_length=1, max_length=32)
    command: Command | None = Field(None, description="null: one fixed range")
    index: tuple[int, ...] | None = Field(None, description="what {index} is for each [default: 0, 1, ...]")
    settle_s: float = Field(0.0, ge=0, le=60, description="after a change")
    discard: int = Field(1, ge=0, le=100, description="readings thrown away after a change")

    @model_validator(mode="after")
    def _ladder(self) -> "Ranges":
        if any(a >= b for a, b in zip(self.full_scale, self.full_scale[1:])):
            raise ValueError("full_scale: each must be above the one before")
        if self.index is not None and len(self.index) != len(self.full_scale):
            raise ValueError(f"index: {len(self.full_scale)} numbers wanted, one a range")
        if self.command is None and len(self.full_scale) > 1:
            raise ValueError("command: missing; more than one range needs one")
        for k in range(len(self.full_scale) if self.command else 0):
            self.set(k)
        return self

    def set(self, k: int) -> str:
        """The command that chooses range k."""
        index = k if self.index is None else self.index[k]
        return filled(self.command or "", full_scale=self.full_scale[k], index=index)


class Integration(Section):
    """How the integration time is set: `command` has {value}, which is the time in units of `unit_s` seconds."""

    command: Command
    unit_s: float = Field(1.0, gt=0, le=60, description="0.001 for milliseconds, 0.02 for power line cycles of 50 Hz")
    lowest: Positive = Field(1e-6, description="value")
    highest: Positive = Field(1e6, description="value")

    @model_validator(mode="after")
    def _usable(self) -> "Integration":
        if not filled(self.command, value=self.lowest) or "{value" not in self.command:
            raise ValueError("command: needs {value}")
        try:
            sent = as_sent(self.command, self.lowest), as_sent(self.command, self.highest)
        except ValueError:
            raise ValueError("command: {value} does not write a number") from None
        if not sent[0] > 0:
            raise ValueError(f"lowest: {self.lowest:g} is sent as 0; write {{value}} with more digits")
        if self.lowest > self.highest:
            raise ValueError("lowest: lies above highest")
        return self


class Instrument(Section):
    """One kind of instrument: how it is spoken to, and what its answers mean.

    `answer` has a group `value`, or `value1`, `value2`, ... for several channels, or `values` for a list that is cut at
    `separator`; and may have `unit`, `range` and `overload` (anything in it means overload).
    """

    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,99}$")
    source: str = Field("", description="the manual that says so")
    serial: SerialLine = SerialLine()
    line_end: Literal["\n", "\r", "\r\n"] = "\n"
    boot_s: float = Field(0.0, ge=0, le=120, description="how long it may be deaf after its port is opened")
    banner: Pattern | None = Field(None, description="a line that it prints when it has started, waited for in boot_s")
    identify: Question | None = None
    init: tuple[Command, ...] = Field((), max_length=64)
    prompt: Line = Field("", description="what it prints before it listens")
    acknowledged: Pattern | None = Field(None, description="what it answers to a command that asks nothing")
    refused: Pattern | None = Field(None, description="a line that means an error")
    ignore: Pattern | None = Field(None, description="lines that mean nothing")
    errors: ErrorQuery | None = None
    query: Line = Field("", description="asks for a reading; empty: it sends readings by itself")
    answer: Pattern = r"\s*(?P<value>\S+)"
    unit: str = Field("V", description="of signals, and of numbers that come without one")
    decimal: Literal["point", "comma"] = "point"
    separator: Pattern = r"\s*[,;\s]\s*"
    count: int = Field(1, ge=1, le=MOST_VALUES, description="how many numbers `values` are")
    overload: Pattern | None = Field(None, description="found in an answer, it means overload")
    overload_above: Positive | None = Field(None, description="a number above means overload")
    ranges: Ranges | None = None
    integration: Integration | None = None
    integrates: bool = Field(False, description="its number grows with the time, as counts do; watts do not")
    reading_s: float = Field(0.1, ge=0, le=600, description="that a reading takes besides the integration time")
    timeout_s: float = Field(1.0, gt=0, le=600, description="that an answer may be late")
    steps: float | None = Field(None, gt=1, description="of its converter in a full scale")
    accuracy: float | None = Field(
        None, gt=0, le=0.5, description="of its ranges and linearity, relative, as the maker says"
    )

    @field_validator("unit")
    @classmethod
    def _unit(cls, v: str) -> str:
        if not UNIT.fullmatch(v):
            raise ValueError("a unit is a word, such as A, nA, W, V or counts")
        return v

    @model_validator(mode="after")
    def _has_values(self) -> "Instrument":
        groups = re.compile(self.answer).groupindex
        several = [g for g in groups if re.fullmatch(r"value[1-9]\d{0,2}", g)]
        if sum(("value" in groups, "values" in groups, bool(several))) != 1:
            raise ValueError("answer: needs a group (?P<value>...), or value1, value2, ..., or values")
        if several and sorted(several) != sorted(f"value{k}" for k in range(1, len(several) + 1)):
            raise ValueError("answer: its groups must be value1, value2, ... without a gap")
        if "values" not in groups and self.count > 1:
            raise ValueError("count: only for a group (?P<values>...)")
        return self

    @property
    def values(self) -> int:
        """How many numbers one answer holds."""
        groups = re.compile(self.answer).groupindex
        return self.count if "values" in groups else sum(bool(re.fullmatch(r"value\d*", g)) for g in groups)


class TextSection(DetectorSection):
    """An instrument that speaks text, as the rig's detector. A signal of 1 is `white` of the description's unit."""

    driver: Literal["text"] = "text"
    instrument: Instrument = Field(description="a YAML file, the name of one that ships, or the description itself")
    port: str = Field("-", min_length=1, description="/dev/serial/by-id/..., or tcp://HOST:PORT")
    baud: int | None = Field(None, ge=50, le=10_000_000, description="where it is not the description's")
    boot_s: float | None = Field(None, ge=0, le=120, description="where it is not the description's")
    white: float = Field(1.0, gt=0, description="about what a white diffuser reads, lit and seen at the normal")
    bands: Bands | None = Field(None, description="of a spectrometer, whose numbers are its pixels")

    @field_validator("instrument", mode="before")
    @classmethod
    def _found(cls, v: Any) -> Any:
        """A name or a file is read: the config of a run then holds all of it."""
        return load_config(find_config(str(v), "instruments"), Instrument) if isinstance(v, str | int) else v

    @field_validator("port")
    @classmethod
    def _port(cls, v: str) -> str:
        if v.startswith("tcp:") and not re.fullmatch(r"tcp://[^\s:/\[\]]+:[1-9]\d{0,4}|tcp://\[[0-9A-Fa-f:]+\]:\d+", v):
            raise ValueError("expected tcp://HOST:PORT, such as tcp://192.168.1.20:5025")
        return v

    @model_validator(mode="after")
    def _as_many_pixels(self) -> "TextSection":
        if self.bands is not None and len(self.bands.wavelengths) != self.instrument.values:
            pixels, values = len(self.bands.wavelengths), self.instrument.values
            raise ValueError(f"bands: {pixels} wavelengths for the {values} numbers of {self.instrument.name}")
        return self

    @property
    def channels(self) -> int:
        return len(self.bands.bands_nm) if self.bands else self.instrument.values

    @property
    def full_scales(self) -> tuple[float, ...]:
        ranges = self.instrument.ranges
        return tuple(f / self.white for f in ranges.full_scale) if ranges else ()

    @property
    def accuracy(self) -> float | None:
        return self.instrument.accuracy

    @property
    def steps(self) -> float | None:
        return self.instrument.steps
