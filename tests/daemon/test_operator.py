"""The operator's guide names only commands and options that exist, and every command of the rig."""

import re
from pathlib import Path

import pytest
import typer

from gonio.cli import app

DOCS = Path(__file__).resolve().parents[2] / "docs"


def commands(group, path=()):
    """{("calibrate", "camera"): options, ...}"""
    out = {}
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            out |= commands(command, (*path, name))
        out[(*path, name)] = {o for p in command.params for o in (*p.opts, *p.secondary_opts)} | {"--help"}
    return out


KNOWN = commands(typer.main.get_command(app))
GUIDE = (DOCS / "operator.md").read_text()


def uses(text):
    """(words, options) of every `gonio ...` in code."""
    for code in re.findall(r"`(gonio [^`]*)`|^    (gonio .*)$", text, re.M):
        line = "".join(code).split("#")[0]
        for one in re.findall(r"gonio ((?:(?!gonio ).)*)", line):
            words = [w.rstrip(";,") for w in one.split()]
            yield tuple(words), {w for w in words if w.startswith("--") and len(w) > 2}


@pytest.mark.parametrize(("words", "options"), list(uses(GUIDE)))
def test_named_commands_exist(words, options):
    key = next((k for n in (2, 1) if (k := words[:n]) in KNOWN), None)
    assert key is not None or words[0].startswith("--"), f"gonio {' '.join(words)}"
    assert options <= (KNOWN[key] if key else {"--help"}), f"gonio {' '.join(words)}"


def test_a_wrong_command_would_be_found():
    (words, options), *_ = uses("`gonio calibrate kamera --rigg x`")
    assert words[:2] not in KNOWN and not options <= KNOWN[("home",)]


def test_every_command_of_the_rig_is_in_the_guide():
    used = {w[:n] for w, _ in uses(GUIDE) for n in (1, 2)}
    rig = "doctor home park jog measure daemon status watch pause stop acquire resume check".split()
    for command in [(c,) for c in rig] + [("calibrate", c) for c in ("camera", "geometry", "radiometry")]:
        assert command in used, command
