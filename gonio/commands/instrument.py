"""read: readings of one instrument on its port, without a rig around it."""

from typing import Annotated

import typer


def register(app: typer.Typer) -> None:
    app.command()(read)


def read(
    instrument: Annotated[str, typer.Argument(help="a description's YAML, or the name of one that ships")],
    port: Annotated[str, typer.Option(help="/dev/serial/by-id/..., or tcp://HOST:PORT")],
    times: Annotated[int, typer.Option("--times", "-n", min=1, max=10_000, help="how many readings")] = 1,
    exposure: Annotated[
        float, typer.Option(min=1e-6, max=600, help="seconds of integration, where it can be set")
    ] = 0.1,
    json: Annotated[bool, typer.Option("--json", help="print JSON")] = False,
) -> None:
    """Read an instrument that speaks text: who it says it is, its numbers, and the very text that they came in."""
    import json as js

    from drivers.text.detector import TextDetector
    from gonio.config import ConfigError
    from gonio.config.detectors import PhotodiodeConfig
    from gonio.config.find import find_config
    from gonio.config.instrument import Instrument, TextSection
    from gonio.config.loader import load_config
    from gonio.rig.clock import RealClock

    known = load_config(find_config(instrument, "instruments"), Instrument)
    try:
        section = TextSection(instrument=known, port=port)
    except ValueError as e:
        raise ConfigError(f"--port {port}: {str(e).splitlines()[2].split('[')[0].strip()}") from None
    detector = TextDetector(section, PhotodiodeConfig(), exposure, RealClock(), grace_s=0)
    try:
        detector.connect()
        if not json:
            typer.echo(f"{known.name}  {detector.instrument.identity!r}")
        for _ in range(times):
            r = detector.read()
            values, range_ = r.value.tolist(), r.raw.get("range", [None])[0]
            if json:
                said = {"value": values, "unit": known.unit, "overload": r.saturated, "range": range_}
                typer.echo(js.dumps({**said, "exposure_s": r.raw["exposure_s"], "reply": r.raw["reply"]}))
                continue
            shown = "  ".join(f"{v:.6g}" for v in values[:16]) + ("  ..." if len(values) > 16 else "")
            of = f"  range {range_ + 1} of {len(detector.full_scale)}" if range_ is not None else ""
            typer.echo(f"{shown}  {known.unit}{of}{'  overload' if r.saturated else ''}  {r.raw['reply']!r}")
    finally:
        detector.close()
