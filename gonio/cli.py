"""gonio: the command line. Each command is a few lines in gonio.commands; errors become one line and an exit code.

Exit codes: 0 done · 1 bug · 2 usage or config · 3 hardware fault · 4 safety stop · 5 calibration missing or stale ·
130 interrupted, resumable.
"""

import sys
from typing import Annotated

import typer

from gonio.commands import acquisition, budget, importing, instrument, materials, owner, products, rig, scene, studies
from gonio.commands.calibrate import app as calibrate
from gonio.commands.lab import init, queue, scan

app = typer.Typer(
    name="gonio",
    help="A Markov chain decides where to look, a rig looks there, and what it saw becomes a BRDF for any renderer.",
    no_args_is_help=True,
    add_completion=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
for group in (acquisition, scan, importing, products, budget, rig, instrument, owner, scene, studies):
    group.register(app)
app.add_typer(calibrate.app, name="calibrate")
app.add_typer(materials.app, name="materials")
app.add_typer(init.app, name="init")
app.add_typer(queue.app, name="queue")


def _version(wanted: bool) -> None:
    if wanted:
        import gonio

        typer.echo(f"gonio {gonio.__version__}")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="say it and end")
    ] = False,
) -> None:
    pass


def main() -> None:
    """Entry point. A user's mistake never prints a traceback; a bug does, and exits with 1."""
    try:
        code = app(standalone_mode=False)
    except typer.Exit as e:
        code = e.exit_code
    except typer.Abort:
        code = 130
    except KeyboardInterrupt:
        code = 130
    except BrokenPipeError:
        code = 0
    except Exception as e:
        code = getattr(e, "exit_code", None)
        if code is None:
            raise
        if hasattr(e, "show"):  # a mistake in the command's own words: usage and a hint
            e.show()
        elif str(e):
            print(f"gonio: {e}", file=sys.stderr)
    sys.exit(code or 0)


if __name__ == "__main__":
    main()
