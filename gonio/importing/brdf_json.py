"""BRDF-JSON, the metrologists' universal BRDF format (Lanevski et al. 2022, Color Research and Application 47, 1177).

`data` holds parallel arrays theta_i, phi_i, theta_r, phi_r (unit deg, rad or °), BRDF (1/sr or %), and, where known,
uBRDF (1/sr, %, relative or 1), wavelength_i or wavelength_r (m to Å), polarization_i, polarization_r (averaged here); a
row a value. Channels other than wavelengths stand under adhoc_variables.channel. The older layout, `variables` with
names and `values` in rows, is read too. Schema: github.com/BiRD-project/BiRD_view,
BRDF_JSON_schema/data_json_schema_v1.0.json and parse_brdf_json.py.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np

from gonio.geometry import Array
from gonio.importing import CannotImport, Readings
from gonio.importing.directions import spherical
from gonio.importing.text import MOST_CHANNELS, read_text

ANGLES = ("theta_i", "phi_i", "theta_r", "phi_r")
DEGREES = ("deg", "°", "degrees", "degree")
INVERSE_SR = ("1/sr", "sr^-1", "sr-1", "sr**-1", "sr⁻¹", "sr^{-1}")
RELATIVE = ("relative", "rel", "rel.", "1", "%")
NANOMETRES = {"": 1, "nm": 1, "m": 1e9, "μm": 1e3, "um": 1e3, "µm": 1e3, "å": 0.1, "angstrom": 0.1}
MOST_BYTES = 40_000_000  # a number of four bytes becomes one of 32


def read(path: Path) -> Readings:
    """Raises CannotImport."""
    data = _data(path)
    columns = {k: _numbers(path, k, data[k]) for k in (*ANGLES, "BRDF")}
    percent = _known(path, "BRDF", data["BRDF"].get("unit"), ("", "1", "-", *INVERSE_SR, "%")) == "%"
    columns["BRDF"] /= 100 if percent else 1
    n = len(columns["BRDF"])
    if any(len(a) != n for a in columns.values()) or n == 0:
        lengths = ", ".join(f"{k} {len(a)}" for k, a in columns.items())
        raise CannotImport(f"{path}: data: arrays of unequal or no length ({lengths})")
    angles = [np.radians(columns[k]) if _degrees(path, k, data[k]) else columns[k] for k in ANGLES]
    sigma = _uncertainty(path, data, columns["BRDF"])
    names, channel = _channels(path, data, n)
    place = np.unique(np.round(np.stack(angles, 1), 9), axis=0, return_inverse=True, return_index=True)
    _, first, row = place
    row = row.ravel()
    value, spread = _pivot(columns["BRDF"], sigma, row, channel, len(first), len(names))
    wi, wo = spherical(*(a[first] for a in angles))
    said = _said(n, len(first), len(names)) + (["BRDF is in per cent, divided by 100"] if percent else [])
    mapping = {k: k for k in ("BRDF", *(["uBRDF"] if sigma is not None else []), *ANGLES)}
    return Readings(wi, wo, value, spread, names, "f", "json", mapping, tuple(said))


def _data(path: Path) -> dict[str, Any]:
    text = read_text(path, MOST_BYTES)
    try:
        whole = json.loads(text)
    except (ValueError, RecursionError) as e:
        where = f"line {e.lineno}" if isinstance(e, json.JSONDecodeError) else "too deep or too large"
        raise CannotImport(f"{path}: not JSON ({where}); mended or written anew, it can be read") from None
    data = whole.get("data") if isinstance(whole, dict) else None
    if not isinstance(data, dict):
        raise CannotImport(f"{path}: no object `data` in it; is it BRDF-JSON?")
    if isinstance(data.get("variables"), list) and isinstance(data.get("values"), list):
        data = _of_rows(path, data["variables"], data["values"])
    if "theta_v" in data:  # the name of before
        data = {{"theta_v": "theta_r", "phi_v": "phi_r"}.get(k, k): v for k, v in data.items()}
    for k in (*ANGLES, "BRDF"):
        if not isinstance(data.get(k), dict):
            raise CannotImport(f"{path}: data.{k}: missing; BRDF-JSON has an object with `unit` and `values`")
    return data


def _of_rows(path: Path, variables: list, values: list) -> dict[str, Any]:
    names = [v.get("name") if isinstance(v, dict) else None for v in variables]
    if any(not isinstance(r, list) or len(r) != len(names) for r in values):
        raise CannotImport(f"{path}: data.values: rows of {len(names)} entries expected, one a variable")
    columns = list(zip(*values))
    return {
        str(name): {"unit": v.get("unit"), "values": list(columns[k]) if columns else []}
        for k, (name, v) in enumerate(zip(names, variables))
        if name is not None
    }


def _numbers(path: Path, key: str, item: dict[str, Any]) -> Array:
    values = item.get("values")
    if not isinstance(values, list) or any(isinstance(v, list | dict | str | bool) for v in values):
        raise CannotImport(f"{path}: data.{key}.values: an array of numbers expected")
    try:
        return np.array([np.nan if v is None else v for v in values], float)
    except (ValueError, TypeError, OverflowError):
        raise CannotImport(f"{path}: data.{key}.values: an array of numbers expected") from None


def _degrees(path: Path, key: str, item: dict[str, Any]) -> bool:
    unit = item.get("unit")
    if unit not in (*DEGREES, "rad", "radians"):
        raise CannotImport(f"{path}: data.{key}.unit: {str(unit)[:40]!r}; deg, ° or rad expected")
    return unit in DEGREES


def _uncertainty(path: Path, data: dict[str, Any], brdf: Array) -> Array | None:
    """Of each value, in 1/sr; from uBRDF, else one for all. `brdf`: without its per cent."""
    if isinstance(item := data.get("uBRDF"), dict):
        u = _numbers(path, "uBRDF", item)
        if len(u) != len(brdf):
            raise CannotImport(f"{path}: data.uBRDF: {len(u)} values, BRDF has {len(brdf)}")
        return _absolute(path, "uBRDF", item.get("unit"), u, brdf)
    one = data["BRDF"].get("uncertainty")
    if isinstance(one, dict) and isinstance(one.get("value"), int | float):
        u = np.full(len(brdf), float(one["value"]))
        return _absolute(path, "BRDF.uncertainty", one.get("unit"), u, brdf)
    return None


def _absolute(path: Path, key: str, unit: object, u: Array, brdf: Array) -> Array:
    if _known(path, key, unit, ("", *INVERSE_SR, *RELATIVE)) not in RELATIVE:
        return u
    return u * np.abs(brdf) / (100 if str(unit).strip() == "%" else 1)


def _known(path: Path, key: str, unit: object, known: tuple[str, ...]) -> str:
    """The unit, lower case, without blanks; "" where none is given. Raises CannotImport where it is none of `known`."""
    text = "" if unit is None else "".join(str(unit).split()).lower()
    if text not in known:
        those = ", ".join(filter(None, known))
        raise CannotImport(f"{path}: data.{key}.unit: {str(unit)[:40]!r}; one of {those} expected")
    return text


def _channels(path: Path, data: dict[str, Any], n: int) -> tuple[tuple[str, ...], Array]:
    """Names, and the number of each row's channel."""
    adhoc = data.get("adhoc_variables")
    texts: list[str] | None = None
    if isinstance(adhoc, dict) and isinstance(adhoc.get("channel"), dict):
        texts = [str(v)[:40] for v in adhoc["channel"].get("values") or []]
    for key in ("wavelength_i", "wavelength_r", "wavelength"):
        if texts is None and isinstance(item := data.get(key), dict):
            scale = NANOMETRES[_known(path, key, item.get("unit"), tuple(NANOMETRES))]
            texts = [f"{v * scale:.6g}nm" for v in _numbers(path, key, item).tolist()]
    if texts is None:
        return ("Y",), np.zeros(n, np.int64)
    names = tuple(dict.fromkeys(texts))
    if len(texts) != n or len(names) > MOST_CHANNELS:
        raise CannotImport(
            f"{path}: {len(texts)} wavelengths or channels for {n} values, {len(names)} of them different"
        )
    number = {name: k for k, name in enumerate(names)}
    return names, np.array([number[t] for t in texts])


def _pivot(value: Array, sigma: Array | None, row: Array, channel: Array, rows: int, channels: int):
    """(rows, channels) means of what stands at one place, such as two polarisations; NaN where nothing does."""
    cell = row * channels + channel
    count = np.bincount(cell, minlength=rows * channels)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.bincount(cell, value, rows * channels) / count
        if sigma is None:
            return mean.reshape(rows, channels), None
        spread = np.bincount(cell, sigma, rows * channels) / count  # of one instrument: they err together
    return mean.reshape(rows, channels), spread.reshape(rows, channels)


def _said(n: int, rows: int, channels: int) -> list[str]:
    mean = n / (rows * channels)
    return (
        [f"{n} values at {rows} pairs of directions: the mean of {mean:.3g} (polarisations, repeats)"]
        if mean > 1.001
        else []
    )
