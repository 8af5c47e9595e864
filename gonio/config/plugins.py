"""Drivers by name, and the sections of a rig's YAML that name one: `{driver: NAME, ...}`.

A package offers a driver by an entry point of the group `gonio.stages`, `gonio.detectors` or `gonio.lights`. Those that
ship are offered in the same way (pyproject.toml); SHIPPED repeats those lines for a source tree that is not installed.
What the class has to be is said in `gonio.rig.driver`.
"""

import importlib
from collections.abc import Mapping
from functools import lru_cache
from importlib.metadata import entry_points
from typing import Any, ClassVar, Self

from pydantic import Field, ModelWrapValidatorHandler, ValidationError, model_validator

from gonio.config.loader import ConfigError, Section, SectionError

SHIPPED = {
    "gonio.stages": {"dynamixel": "drivers.doors:Dynamixel", "grbl": "drivers.doors:Grbl"},
    "gonio.detectors": {"photodiode": "drivers.doors:SerialPhotodiode", "text": "drivers.doors:Text"},
    "gonio.lights": {"lamp": "drivers.doors:Lamp"},
}
# where their sections are: reading a YAML file need not import a driver
SECTIONS = {
    "dynamixel": "gonio.config.devices:ServoBusConfig",
    "grbl": "gonio.config.devices:GrblConfig",
    "photodiode": "gonio.config.devices:PhotodiodePort",
    "text": "gonio.config.instrument:TextSection",
    "lamp": "gonio.config.devices:LampConfig",
}


class DeviceSection(Section):
    """Base of the section of any driver: `driver` names it. A plug-in's own `Config` inherits from one of the three
    below, which read any of their kind."""

    group: ClassVar[str] = ""
    default: ClassVar[str | None] = None  # the driver of a section that names none

    driver: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,99}$")

    @classmethod
    def chosen(cls, data: Mapping[str, Any]) -> "type[DeviceSection]":
        """The section class of the driver that `data` names; `cls` itself where no such driver is installed."""
        name = cls.named(data).get("driver")
        if cls.__dict__.get("group") is None or not isinstance(name, str):
            return cls
        if name in SHIPPED.get(cls.group, ()):
            found: type[DeviceSection] = _object(SECTIONS[name])
            return found
        return driver(cls.group, name).Config if name in _installed(cls.group) else cls

    @classmethod
    def named(cls, data: Mapping[str, Any]) -> dict[str, Any]:
        """`data` with its driver named."""
        return dict(data) if cls.default is None else {"driver": cls.default, **data}

    @property
    def known(self) -> bool:
        """Whether its driver is installed: else nothing but its name was read."""
        return type(self).__dict__.get("group") is None

    @property
    def ports(self) -> tuple[str, ...]:
        """What no other process may use meanwhile."""
        port = getattr(self, "port", None)
        return (port,) if isinstance(port, str) else ()

    @model_validator(mode="wrap")
    @classmethod
    def _of_its_driver(cls, data: Any, handler: ModelWrapValidatorHandler[Self]) -> Any:
        if not isinstance(data, Mapping) or cls.__dict__.get("group") is None:
            return handler(data)
        data, chosen = cls.named(data), cls.chosen(data)
        if chosen is not cls:
            try:
                return chosen.model_validate(data)
            except ValidationError as e:
                raise SectionError(e.errors(include_url=False)[0], chosen) from None
        return handler({k: v for k, v in data.items() if k == "driver"})


class StageSection(DeviceSection):
    """`devices.stage` of a rig's YAML."""

    group: ClassVar[str] = "gonio.stages"
    default: ClassVar[str | None] = "dynamixel"

    @property
    def joints(self) -> tuple[str, ...] | None:
        """Names of the axes that it says it moves, None = it does not say."""
        return None


class LightSection(DeviceSection):
    """`devices.light` of a rig's YAML."""

    group: ClassVar[str] = "gonio.lights"
    default: ClassVar[str | None] = "lamp"


class DetectorSection(DeviceSection):
    """`detector` of a rig's YAML, where it is neither `photodiode` nor `camera`."""

    group: ClassVar[str] = "gonio.detectors"

    @classmethod
    def named(cls, data: Mapping[str, Any]) -> dict[str, Any]:
        """`kind` is another word for `driver`."""
        known = dict(data)
        return {"driver": known.pop("kind"), **known} if "kind" in known and "driver" not in known else known

    @property
    def channels(self) -> int | None:
        """How many it reads, None = it says so when it is opened."""
        return None

    @property
    def full_scales(self) -> tuple[float, ...]:
        """Of each range, in units of the signal, lowest first; () = it has none, or does not say."""
        return ()

    @property
    def accuracy(self) -> float | None:
        """Of its ranges and its linearity, relative, as the maker says; None = nobody says."""
        return None

    @property
    def steps(self) -> float | None:
        """Of its converter in a full scale; None = finer than its noise."""
        return None


def driver(group: str, name: str) -> Any:
    """The driver class of this name. Raises ConfigError where none is installed, or it is none."""
    if (where := SHIPPED[group].get(name)) is not None:
        return _object(where)
    entry = _installed(group).get(name)
    if entry is None:
        known = ", ".join(names(group))
        raise ConfigError(f"driver {name}: not installed as one of {group} ({known}); pip install what offers it")
    try:
        found = entry.load()
    except Exception as e:  # whatever a plug-in's import may raise
        raise ConfigError(f"driver {name}: {entry.value} cannot be imported ({type(e).__name__}: {e})") from None
    section = getattr(found, "Config", None)
    if not (isinstance(section, type) and issubclass(section, DeviceSection)):
        raise ConfigError(f"driver {name}: {entry.value} has no `Config`, a section of gonio.config.plugins")
    return found


def names(group: str) -> list[str]:
    """Of all drivers of a group, installed or shipped."""
    return sorted({*SHIPPED[group], *_installed(group)})


def _object(where: str) -> Any:
    module, _, attribute = where.partition(":")
    return getattr(importlib.import_module(module), attribute)


@lru_cache(None)
def _installed(group: str) -> dict[str, Any]:
    return {e.name: e for e in entry_points(group=group)}
