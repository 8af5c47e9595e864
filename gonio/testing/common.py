"""What the checks of all kinds of drivers share."""

import threading
from collections.abc import Callable
from typing import Any

from gonio.config.plugins import DeviceSection
from gonio.rig.errors import DeviceFault

PATIENCE_S = 60.0  # beyond which a call counts as hanging

Make = Callable[[], Any]
Do = Callable[[], object]


class Nonconformity(AssertionError):
    """What a driver does not keep, in one line."""


def require(kept: object, what: str) -> None:
    if not kept:
        raise Nonconformity(what)


def in_thread(act: Do, what: str) -> Any:
    """What `act` returns or raises, from a thread of its own."""
    done: dict[str, Any] = {}

    def run() -> None:
        try:
            done["value"] = act()
        except BaseException as e:
            done["error"] = e

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(PATIENCE_S)
    require(not thread.is_alive(), f"{what} does not end within {PATIENCE_S:g} s")
    if "error" in done:
        raise done["error"]
    return done["value"]


def check_class(device: Any) -> None:
    """Its section of a rig's YAML."""
    section = getattr(type(device), "Config", None)
    require(
        isinstance(section, type) and issubclass(section, DeviceSection), "Config: no section of gonio.config.plugins"
    )
    require(section.model_config.get("extra") == "forbid", "Config: takes unknown keys")  # type: ignore[union-attr]


def check_doctor(make: Make) -> None:
    """Lines with a verdict each; the device is not connected before."""
    device = make()
    try:
        lines = list(device.doctor())
    finally:
        device.close()
    require(lines, "doctor: says nothing")
    for line in lines:
        require(line[:5] in ("ok   ", "warn ", "FAIL "), f"doctor: {line!r} does not begin with ok, warn or FAIL")
        require("\n" not in line, f"doctor: {line!r} is more than one line")
    require(not any(x.startswith("FAIL") for x in lines), f"doctor: a healthy device: {lines[-1]}")


def check_closing(make: Make) -> None:
    """`close` never raises: before `connect`, after it, and twice."""
    device = make()
    device.close()
    device = make()
    device.connect()
    device.close()
    device.close()


def check_fault(make: Make, act: Callable[[Any], object], fault: Do | None, mend: Do | None) -> None:
    """A device that breaks is a DeviceFault in one line, `close` is quiet all the same, and mended it opens again."""
    if fault is None:
        return
    device = make()
    device.connect()
    fault()
    try:
        expect_fault(lambda: act(device), "a device that broke")
        device.close()
        if mend is None:
            return
        expect_fault(lambda: _opened(make), "connecting to a device that broke")
    finally:
        device.close()
        if mend is not None:
            mend()
    _opened(make)


def expect_fault(act: Do, what: str) -> None:
    """That `act` raises a DeviceFault that names part, cause and remedy."""
    try:
        in_thread(act, what)
    except DeviceFault as e:
        require("\n" not in str(e), f"{what}: {e} is more than one line")
        require(e.axis and e.cause and e.remedy, f"{what}: {e} does not name part, cause and remedy")
    except Exception as e:
        raise Nonconformity(f"{what}: {type(e).__name__} ({e}) in place of a DeviceFault") from e
    else:
        raise Nonconformity(f"{what}: nothing is raised")


def _opened(make: Make) -> None:
    device = make()
    try:
        device.connect()
    finally:
        device.close()
