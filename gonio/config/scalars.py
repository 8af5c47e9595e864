"""What a plain scalar of a YAML file means is what its key is for: `name: 007` is text, `measurements: 1e4` a number.

YAML 1.1 reads 007 as 7, 010 as 8, 1:30 as 90, 450 as a number, `no` as false, `null` as nothing and 1e4 as text. A key
that can only be text takes the scalar as it is written; one that can only be a number takes 1e4 as 10000, 010 as 10 and
refuses 1:30. One that may be either (`metadata`) takes a number only where it is written as anybody would write it.
"""

import re
import types
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import yaml
from pydantic import BaseModel

EXPONENT = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d{1,3}")
DECIMAL = re.compile(r"[-+]?(0|[1-9]\d*)?\.\d+([eE][-+]?\d{1,3})?|[-+]?\d+\.([eE][-+]?\d{1,3})?")
OCTAL = re.compile(r"[-+]?0\d+")


def as_keys_want(data: Any, node: yaml.Node | None, *wanted: Any) -> Any:
    """`data`, loaded from `node`, with its scalars as a key of one of the types `wanted` (models, …) means them."""
    options = [o for w in wanted for o in _options(w)]
    if isinstance(node, yaml.MappingNode) and isinstance(data, Mapping):
        nodes = {k.value: v for k, v in node.value}
        options = [o.chosen(data) if hasattr(o, "chosen") else o for o in options]  # the section of a driver
        return {key: as_keys_want(value, nodes.get(key), *_of_key(options, key)) for key, value in data.items()}
    if isinstance(node, yaml.SequenceNode) and isinstance(data, list):
        items = [a for o in options for a in get_args(o) if get_origin(o) in (tuple, list) and a is not Ellipsis]
        return [as_keys_want(value, inner, *items) for value, inner in zip(data, node.value)]
    if not isinstance(node, yaml.ScalarNode) or node.style:  # quoted
        return data
    if data is None and (type(None) in options or node.value in ("", "~")):
        return data
    leaves = {o for o in options if o is not type(None)}
    if leaves >= {str, int, float, bool}:
        return data if data is None else _as_written(data, node.value)
    if leaves and all(o in (str, Path) or _is_literal_text(o) for o in leaves):
        return node.value
    if int in leaves and str not in leaves and EXPONENT.fullmatch(node.value):
        number = float(node.value)
        return int(number) if number.is_integer() else number
    if leaves & {int, float} and str not in leaves:
        if OCTAL.fullmatch(node.value):
            return int(node.value)
        if ":" in node.value:  # in base sixty, to YAML alone
            return node.value
    return data


def _as_written(data: Any, written: str) -> Any:
    """The number or truth value that anybody would read, else text: 007, 1:30, 1e4, `no` and 1_000 are text."""
    if isinstance(data, bool):
        return data if written in ("true", "false") else written
    if isinstance(data, int) and str(data) == written:
        return data
    return float(written) if DECIMAL.fullmatch(written) else written


def _options(annotation: Any) -> list[Any]:
    """The types a value may have: unions and `Annotated` taken apart."""
    if get_origin(annotation) is Annotated:
        return _options(get_args(annotation)[0])
    if get_origin(annotation) in (Union, types.UnionType):
        return [o for a in get_args(annotation) for o in _options(a)]
    return [annotation]


def _of_key(options: list[Any], key: Any) -> list[Any]:
    """The annotations of a mapping's value at `key`; none where the key is not known."""
    models = [o for o in options if isinstance(o, type) and issubclass(o, BaseModel) and key in o.model_fields]
    return [m.model_fields[key].annotation for m in models] + [get_args(o)[1] for o in options if get_origin(o) is dict]


def _is_literal_text(option: Any) -> bool:
    return get_origin(option) is Literal and all(isinstance(v, str) for v in get_args(option))
