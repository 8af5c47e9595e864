"""What --json prints: one object on one line, of JSON that every reader takes (no NaN, no Infinity: null)."""

from typing import Any

import typer


def say(figures: dict[str, Any]) -> None:
    import json

    typer.echo(json.dumps(_finite(figures), ensure_ascii=False, allow_nan=False))


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(v) for key, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    return None if isinstance(value, float) and not abs(value) < float("inf") else value
