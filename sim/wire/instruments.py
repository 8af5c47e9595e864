"""Emulated instruments that speak plain text, each a table after its manual, not after its description in YAML."""

from collections.abc import Callable

import numpy as np

from gonio.config.loader import ConfigError
from sim.wire.meter import Meter
from sim.wire.plain import PlainDevice, Row

NO_ERROR = '0,"No error"'


class Scpi(PlainDevice):
    """A queue of errors, and words that it does not know go into it."""

    def __init__(self, rows: list[Row], *, end: str = "\n"):
        self.errors: list[str] = []
        super().__init__(
            [
                (r"\*CLS", self._clear),
                (r"SYST:ERR\?", lambda: self.errors.pop(0) if self.errors else NO_ERROR),
                *rows,
                (r".*", lambda: self.errors.append('-113,"Undefined header"')),
            ],
            end=end,
        )

    def _clear(self) -> None:
        self.errors = []


class Keithley6485(Scpi):
    """A picoammeter. One range at a time; above 105 % of it a reading overflows."""

    def __init__(self, meter: Meter):
        self.meter = meter
        self._reset()
        super().__init__(
            [
                (r"\*IDN\?", lambda: "KEITHLEY INSTRUMENTS INC.,MODEL 6485,4038279,C01   Jun 23 2010 12:22:00/A02  /H"),
                (r"\*RST", self._reset),
                (r"SYST:ZCH OFF", self._zero_check_off),
                (r"FORM:ELEM ([A-Z,]+)", self._elements),
                (r"SYST:AZER ON|AVER OFF|MED OFF|TRIG:COUN 1", lambda: None),
                (r"CURR:RANG ([-+.\dE]+)", self._range),
                (r"CURR:NPLC ([.\d]+)", self._nplc),
                (r"READ\?", self._read),
            ]
        )

    def _reset(self) -> None:
        self.range, self.nplc, self.zero_check, self.stamp = 2e-4, 1.0, True, 0.0
        self.elements: tuple[str, ...] = ("READ",)

    def _zero_check_off(self) -> None:
        self.zero_check = False

    def _elements(self, names: str) -> None:
        self.elements = tuple(names.split(","))

    def _range(self, upper: str) -> None:
        ladder = [2e-9 * 10**k for k in range(8)]
        self.range = next((f for f in ladder if f >= float(upper) * 0.999), ladder[-1])
        self.meter.settle()

    def _nplc(self, value: str) -> None:
        if 0.01 <= float(value) <= 50:
            self.nplc = float(value)
        else:
            self.errors.append('-222,"Parameter data out of range"')

    def _read(self) -> str:
        self.busy_s = self.meter.clock.hurry(self.nplc * 0.02)
        self.stamp += self.nplc * 0.02
        amps = 0.0 if self.zero_check else float(self.meter.read(self.nplc * 0.02)[0])
        step = self.range / 200_000
        over = abs(amps) > 1.05 * self.range
        said = {
            "READ": "+9.9E37" if over else f"{round(amps / step) * step:+.6E}",
            "UNIT": "A",
            "TIME": f"{self.stamp:+.6E}",
            "STAT": f"{1.0 if over else 0.0:+.6E}",
        }
        text = said["READ"] + (said["UNIT"] if "UNIT" in self.elements else "")
        return ",".join([text, *(said[e] for e in ("TIME", "STAT") if e in self.elements)])


class ThorlabsPm100(Scpi):
    """A power meter with a photodiode head."""

    def __init__(self, meter: Meter):
        self.meter, self.range, self.count = meter, 5e-3, 1
        super().__init__(
            [
                (r"\*IDN\?", lambda: "Thorlabs,PM100D,P0012345,2.4.0"),
                (r"CONF:POW|SENS:POW:UNIT W|SENS:POW:RANG:AUTO OFF", lambda: None),
                (r"SENS:POW:RANG:UPP ([-+.\dE]+)", self._range),
                (r"SENS:AVER:COUN (\d+)", self._average),
                (r"MEAS:POW\?", self._read),
            ]
        )

    def _range(self, upper: str) -> None:
        self.range = float(upper)
        self.meter.settle()

    def _average(self, count: str) -> None:
        self.count = int(count)

    def _read(self) -> str:
        self.busy_s = self.meter.clock.hurry(self.count * 0.003)
        watts = float(self.meter.read(self.count * 0.003)[0])
        return "9.90000000E+37" if watts > 1.1 * self.range else f"{watts:.8E}"


class Ophir(PlainDevice):
    """A Vega with a photodiode head of three ranges, 0 the highest."""

    def __init__(self, meter: Meter):
        self.meter, self.ranges, self.range = meter, (3e-3, 3e-4, 3e-5), 0
        super().__init__(
            [
                (r"\$II", lambda: "*VEGA 123456 VE1.35"),
                (r"\$FP", lambda: "*"),
                (r"\$WN (\d)", self._set),
                (r"\$SP", self._read),
            ],
            end="\r\n",
            unknown="?UC",
        )

    def _set(self, index: str) -> str:
        if int(index) >= len(self.ranges):
            return "?PARAM ERROR"
        self.range = int(index)
        self.meter.settle()
        return "*"

    def _read(self) -> str:
        watts = float(self.meter.read()[0])
        return "*OVER" if watts > self.ranges[self.range] else f"*{watts:.4E}"


class ArduinoLine(PlainDevice):
    """It sends a number when it is asked for nothing: `tick()` is one turn of its loop."""

    def __init__(self, meter: Meter):
        self.meter = meter
        super().__init__([])

    def tick(self) -> bytes:
        counts = int(np.clip(np.rint(self.meter.read()[0]), 0, 1023))
        return f"{self.altered(str(counts))}\r\n".encode()


KINDS: dict[str, Callable[[Meter], PlainDevice]] = {
    "keithley_6485": Keithley6485,
    "thorlabs_pm100": ThorlabsPm100,
    "ophir_rs232": Ophir,
    "arduino_line": ArduinoLine,
}


def instrument(name: str, meter: Meter) -> PlainDevice:
    """The emulator of an instrument. Raises ConfigError where there is none."""
    refuse_unknown(name)
    return KINDS[name](meter)


def refuse_unknown(name: str) -> None:
    """Raises ConfigError for an instrument that has no emulator."""
    if name not in KINDS:
        raise ConfigError(
            f"detector.instrument: no emulator of {name} on rigs of depth wire; there is {', '.join(KINDS)}"
        )
