"""What an instrument's answer means: numbers in the description's unit, or an overload. Nothing is guessed."""

import re
from dataclasses import dataclass

import numpy as np

from drivers.numbers import decimal
from gonio.config.instrument import Instrument, factor_of
from gonio.geometry import Array

SCPI_NAN = 9.905e37  # and above: what SCPI instruments say for "not a number"; 9.9E37 is their overload
SCPI_OVERLOAD = 9.0e37  # and above: an overload, where the description does not say what one looks like
LONGEST_NUMBER = 40


@dataclass(frozen=True)
class Answer:
    """values (C,) in the description's unit; they mean nothing where it is an overload. range: as it was said."""

    values: Array
    overload: bool
    range: str | None
    text: str


class Answers:
    """Reads the answers of one kind of instrument."""

    def __init__(self, instrument: Instrument):
        self.i = instrument
        self.pattern = re.compile(instrument.answer)
        self._overload = re.compile(instrument.overload) if instrument.overload else None
        groups = self.pattern.groupindex
        self._names = sorted((g for g in groups if re.fullmatch(r"value\d*", g)), key=lambda g: int(g[5:] or 0))

    def read(self, text: str) -> Answer:
        """Raises ValueError that says what is wrong with it."""
        nothing = np.full(self.i.values, np.nan)
        if self._overload and self._overload.search(text):
            return Answer(nothing, True, None, text)
        found = self.pattern.fullmatch(text.strip())
        if found is None:
            raise ValueError("does not match `answer` of its description")
        groups = found.groupdict()
        said = groups.get("range")
        if groups.get("overload"):
            return Answer(nothing, True, said, text)
        words = re.split(self.i.separator, groups["values"].strip()) if "values" in groups else None
        numbers = [self._number(w) for w in (words if words is not None else [groups[n] or "" for n in self._names])]
        if len(numbers) != self.i.values:
            raise ValueError(f"{len(numbers)} numbers in place of {self.i.values}")
        values = np.array(numbers)
        if (np.abs(values) >= SCPI_NAN).any():
            raise ValueError("not a number, by SCPI's convention (9.91E37)")
        if self._too_much(np.abs(values)):
            return Answer(nothing, True, said, text)
        unit = groups.get("unit")
        return Answer(values * (factor_of(unit, self.i.unit) if unit else 1.0), False, said, text)

    def _too_much(self, sizes: Array) -> bool:
        """Whether any of the numbers means overload: by the description or, where it names none, by SCPI's 9.9E37."""
        if self.i.overload_above is not None:
            return bool((sizes > self.i.overload_above).any())
        return self.i.overload is None and bool((sizes >= SCPI_OVERLOAD).any())

    def _number(self, text: str) -> float:
        text = text.strip()
        if len(text) > LONGEST_NUMBER:
            raise ValueError("a number of too many digits")
        if self.i.decimal == "comma":
            if "." in text:
                raise ValueError(f"{text!r}: a point where `decimal` says comma")
            text = text.replace(",", ".")
        elif "," in text:
            raise ValueError(f"{text!r}: a comma where `decimal` says point")
        value = decimal(text)
        if not np.isfinite(value):
            raise ValueError(f"{text!r} is too large a number")
        return value
