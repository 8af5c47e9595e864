"""Packages of the optional extras, asked for by name."""

from importlib import import_module


class MissingExtra(RuntimeError):
    """A package of an optional extra is needed and not installed. One line with the command that installs it."""

    exit_code = 2


def needs(module: str, extra: str):
    """The module, or MissingExtra with what to type."""
    try:
        return import_module(module)
    except ImportError as e:
        raise MissingExtra(f"this needs {module.split('.')[0]} ({e}); pip install 'gonio[{extra}]'") from None
