"""YAML text -> pydantic model, with errors that say file, line and key in one line."""

import difflib
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar, get_args

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from gonio.config.scalars import as_keys_want

MAX_BYTES = 1_000_000
MAX_DEPTH = 20


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """The C twin of SafeLoader, where there is one; it leaves dates as they are written: a key's type reads them."""

    yaml_implicit_resolvers = {
        first: [(tag, pattern) for tag, pattern in known if not tag.endswith(":timestamp")]
        for first, known in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }


class ConfigError(ValueError):
    """A config that cannot be used. The message is one line: file, line, key, what is wrong, what to do."""

    exit_code = 2


class SectionError(ValueError):
    """What is wrong inside a section that was read as `model`: the first of pydantic's errors, `first`."""

    def __init__(self, first: Any, model: type[BaseModel]):
        super().__init__(first["msg"])
        self.first, self.model = first, model


class Section(BaseModel):
    """Base of every section of a config: unknown keys, NaN and infinities are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, validate_default=True)


Model = TypeVar("Model", bound=BaseModel)


def load_config(path: str | os.PathLike[str], model: type[Model], overrides: Iterable[str] = ()) -> Model:
    """The config of `path` as `model`; each of `overrides` is `a.b=value` (value in YAML). Raises ConfigError."""
    path = Path(path)
    try:
        size = path.stat().st_size
        if not path.is_file():
            raise ConfigError(f"{path}: not a file; name a YAML file")
        if size > MAX_BYTES:
            raise ConfigError(
                f"{path}: {size} bytes is too large for a config (limit {MAX_BYTES}); is it the right file?"
            )
        text = path.read_bytes().decode("utf-8")
    except UnicodeDecodeError as e:
        raise ConfigError(f"{path}: byte {e.start}: not UTF-8 text; save it as UTF-8") from None
    except OSError as e:
        raise ConfigError(f"{path}: {e.strerror or e}; name an existing YAML file") from None
    return parse_config(text, model, overrides, source=str(path))


def parse_config(text: str, model: type[Model], overrides: Iterable[str] = (), source: str = "config") -> Model:
    """As `load_config`, from text."""
    data, node, lines = _read(text, source)
    data = as_keys_want(data, node, model)
    for item in overrides:
        _override(data, item, model)
    try:
        return model.model_validate(data)
    except ValidationError as e:
        raise ConfigError(_explain(e, model, lines, source, overrides)) from None
    except RecursionError:
        raise ConfigError(f"{source}: nested too deeply") from None


def _read(text: str, source: str) -> tuple[dict[str, Any], yaml.Node, dict[tuple, int]]:
    try:
        problem = _unwanted(text)
        if problem:
            raise ConfigError(f"{source}:{problem}")
        node = yaml.compose(text, Loader=_Loader)
        data = yaml.load(text, Loader=_Loader)
    except ConfigError:
        raise
    except yaml.YAMLError as e:
        mark = getattr(e, "problem_mark", None) or getattr(e, "context_mark", None)
        where = f":{mark.line + 1}" if mark else ""
        what = getattr(e, "problem", None) or getattr(e, "reason", None) or "not valid YAML"
        raise ConfigError(f"{source}{where}: {_one_line(what)}") from None
    except (ValueError, TypeError, OverflowError, RecursionError) as e:
        raise ConfigError(f"{source}: {_one_line(e)}") from None
    if not isinstance(data, dict):
        found = "nothing" if data is None else type(data).__name__
        raise ConfigError(f"{source}: expected keys and values, found {found}")
    lines: dict[tuple, int] = {}
    assert node is not None  # a document that is a dict has a node
    _index(node, (), lines, source)
    return data, node, lines


def _unwanted(text: str) -> str | None:
    """Aliases can make a small file stand for a gigabyte, and deep nesting overflow the stack: no config needs them."""
    depth = 0
    for event in yaml.parse(text, Loader=_Loader):
        line = event.start_mark.line + 1 if event.start_mark else 0
        if isinstance(event, yaml.AliasEvent):
            return f"{line}: aliases (*name) are not used here; write it out"
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > MAX_DEPTH:
            return f"{line}: nested more than {MAX_DEPTH} deep"
    return None


def _index(node: yaml.Node, path: tuple, lines: dict[tuple, int], source: str) -> None:
    """Line of every key by its path; a key given twice is an error."""
    lines.setdefault(path, node.start_mark.line + 1)
    if isinstance(node, yaml.MappingNode):
        seen = set()
        for key, value in node.value:
            if key.value in seen if isinstance(key.value, str) else False:
                raise ConfigError(f"{source}:{key.start_mark.line + 1}: {key.value}: given twice; keep one")
            if isinstance(key.value, str):
                seen.add(key.value)
                lines[(*path, key.value)] = key.start_mark.line + 1
                _index(value, (*path, key.value), lines, source)
    elif isinstance(node, yaml.SequenceNode):
        for i, value in enumerate(node.value):
            _index(value, (*path, i), lines, source)


def _override(data: dict[str, Any], item: str, model: type[BaseModel]) -> None:
    key, sign, value = item.partition("=")
    names = key.strip().split(".")
    if not sign or not all(names):
        raise ConfigError(f"--set {item}: expected key.subkey=value")
    try:
        parsed, node = yaml.load(value, Loader=_Loader), yaml.compose(value, Loader=_Loader)
    except (yaml.YAMLError, ValueError) as e:
        raise ConfigError(f"--set {item}: the value is not YAML ({_one_line(e)})") from None
    for name in reversed(names):  # as if it stood in the file, so that its key's type is found the same way
        parsed = {name: parsed}
        if node is not None:
            node = yaml.MappingNode("tag:yaml.org,2002:map", [(yaml.ScalarNode("tag:yaml.org,2002:str", name), node)])
    parsed = as_keys_want(parsed, node, model)
    for name in names[:-1]:
        parsed = parsed[name]
        inner = data.get(name)
        if not isinstance(inner, dict):
            inner = data[name] = {}
        data = inner
    data[names[-1]] = parsed[names[-1]]


def _explain(error: ValidationError, model: type[BaseModel], lines: Mapping[tuple, int], source: str, overrides) -> str:
    all_of_them: list[Any] = error.errors(include_url=False)
    # of a key that is a word or a section, what is wrong with the section
    first = next((e for e in all_of_them if isinstance(e.get("ctx", {}).get("error"), SectionError)), all_of_them[0])
    loc, known = tuple(first["loc"]), _known(model, tuple(first["loc"])[:-1])
    while isinstance(inner := first.get("ctx", {}).get("error"), SectionError):
        loc = (*(k for n, k in enumerate(loc) if loc[: n + 1] in lines), *inner.first["loc"])
        known = _known(inner.model, tuple(inner.first["loc"])[:-1])
        first = inner.first
    keys = tuple(
        k for k in loc if (*loc[: loc.index(k)], k) in lines or not str(k).startswith(("function-", "literal"))
    )
    name = ".".join(map(str, keys)) or "config"
    line = next((lines[keys[:n]] for n in range(len(keys), -1, -1) if keys[:n] in lines), None)
    by_hand = any(o.partition("=")[0].strip() == name for o in overrides)
    where = f"--set {name}" if by_hand else f"{source}:{line}: {name}" if line else f"{source}: {name}"
    if first["type"] == "extra_forbidden":
        near = difflib.get_close_matches(str(keys[-1]), known, n=1)
        return f"{where}: unknown key" + (f"; did you mean {near[0]}?" if near else "")
    if first["type"] == "missing":
        return f"{where}: missing; it has no default"
    message = _one_line(first["msg"].removeprefix("Value error, "))
    given = first.get("input")
    shown = f" (found {_one_line(repr(given))[:60]})" if isinstance(given, str | int | float | bool | None) else ""
    return f"{where}: {message[0].lower()}{message[1:]}{shown}"


def _known(model: Any, path: tuple) -> list[str]:
    """Keys known at a path, walking through nested models and unions of them."""
    models = [model]
    for key in path:
        found: list[Any] = []
        for m in models:
            field = m.model_fields.get(str(key))
            if field is not None:
                found += _models_in(field.annotation)
            elif isinstance(key, int):
                found.append(m)
        models = found or models
    return [name for m in models for name in m.model_fields]


def _models_in(annotation: Any) -> list[Any]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [m for a in get_args(annotation) for m in _models_in(a)]


def _one_line(text: Any) -> str:
    return " ".join(str(text).split())[:200]
