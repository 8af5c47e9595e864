"""A sample and the run to make of it, from a name, a YAML file, or keywords."""

import json
import os
from collections.abc import Iterator, Mapping
from typing import Any

from gonio.config import ConfigError
from gonio.config import Material as MaterialConfig
from gonio.config.find import find_config
from gonio.config.loader import load_config, parse_config

WHOLE = ("metadata",)  # mappings whose keys are the user's own


class Material(MaterialConfig):
    """`Material(source, **keys)`: source is a YAML file, or the name of a material that ships; None to begin afresh.

    keys are those of the YAML; a mapping changes only what it names. Raises ConfigError for a key or value that the
    YAML would refuse, too.

    Examples:
        >>> import gonio
        >>> felt = gonio.Material(name="felt", channels=["L"], budget={"measurements": 300})
        >>> felt.budget.measurements, felt.symmetry
        (300, 'isotropic')
        >>> gonio.Material("analytic_gloss", seed=7, budget={"measurements": 50}).seed
        7
        >>> gonio.Material(name="felt", budget={"measurments": 3})
        Traceback (most recent call last):
        ...
        gonio.config.loader.ConfigError: Material: budget.measurments: unknown key; did you mean measurements?
    """

    def __init__(self, source: str | os.PathLike[str] | None = None, /, **keys: Any):
        overrides = tuple(f"{key}={_json(key, value)}" for key, value in _leaves("", keys))
        try:
            if source is None:
                found = parse_config("{}", MaterialConfig, overrides, source="Material")
            else:
                found = load_config(find_config(source, "materials"), MaterialConfig, overrides)
        except ConfigError as e:
            raise ConfigError(str(e).replace("--set ", "Material: ", 1).replace("Material:1: ", "Material: ")) from None
        super().__init__(**{name: getattr(found, name) for name in MaterialConfig.model_fields})


def _leaves(above: str, keys: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    for key, value in keys.items():
        if isinstance(value, Mapping) and value and key not in WHOLE:
            yield from _leaves(f"{above}{key}.", value)
        else:
            yield f"{above}{key}", value


def _json(key: str, value: Any) -> str:
    """`value` as YAML that cannot be misread: JSON. NumPy's numbers and arrays are taken as Python's."""
    try:
        if hasattr(value, "model_dump"):
            value = value.model_dump(mode="json")
        return json.dumps(value, default=lambda v: v.tolist() if hasattr(v, "tolist") else os.fspath(v))
    except (TypeError, ValueError) as e:
        raise ConfigError(f"Material: {key}: {e}; give what YAML can hold") from None
