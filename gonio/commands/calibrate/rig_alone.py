"""The rig for one calibrating command, which nobody else drives meanwhile, and the operator's hand beside it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from gonio.commands.rig import rig_config

if TYPE_CHECKING:
    from gonio.config.rig import RigConfig
    from gonio.daemon.rig_owner import RigOwner


FOLDER = Path("calibrations")


def ask(owner: "RigOwner", yes: bool) -> Callable[[str], None]:
    """Tells the operator what to put in the sample's place, and waits; on a simulated rig it lies there at once."""
    if yes or owner.config.depth != "real":
        return lambda what: typer.echo(f"put   {what}")
    return lambda what: typer.prompt(
        f"put   {what}; then press Enter", default="", show_default=False, prompt_suffix=" "
    )


@contextmanager
def owned(rig: str, making: str | None = None, out: Path = FOLDER) -> Iterator["RigOwner"]:
    """The rig's devices for this command alone, which makes a calibration of kind `making` in the folder out.

    Raises ConfigError; SocketsError where somebody else drives them.
    """
    from gonio.commands.calibrate.calibrated import about_to_make
    from gonio.daemon.rig_owner import RigOwner

    config = rig_config(rig)
    if making is not None:
        config = about_to_make(config, making, out)
    with alone(config), RigOwner(config) as owner:
        yield owner


@contextmanager
def alone(config: "RigConfig") -> Iterator[None]:
    """Nobody else may drive the rig meanwhile. Raises ConfigError, SocketsError."""
    from gonio.config import ConfigError
    from gonio.daemon.client import find
    from gonio.daemon.sockets import hold_hardware

    if config.depth == "ideal":
        raise ConfigError(f"rig {config.name} is ideal and has no detector to calibrate")
    if find(config.name) is not None:
        raise ConfigError(f"rig {config.name}: a daemon drives it; end the daemon, calibrate, start it again")
    with hold_hardware(config):
        yield
