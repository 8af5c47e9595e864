"""A run's readings as BRDF-JSON with their uncertainties; the layout is that of `gonio.importing.brdf_json`.

uBRDF is the standard uncertainty (k = 1) of each value: its noise, and of a calibrated rig what all readings share.
What the schema wants and nobody here knows (organisation, address, contact) is left for who publishes the file.
"""

import json
import os
import re
import time
import uuid
import warnings
from pathlib import Path
from typing import Any

import numpy as np

import gonio
from gonio.atomic import write_text
from gonio.brdf import Brdf
from gonio.export import ExportError, ExportWarning
from gonio.export.about import about, lines
from gonio.export.intervals import Shared
from gonio.geometry import to_angles
from gonio.run.record.config import read_config
from gonio.run.record.samples import load_samples
from gonio.run.record.store import Store

SCHEMA = "https://raw.githubusercontent.com/BiRD-project/BiRD_view/master/BRDF_JSON_schema/brdf_json_schema_v1.0.json"

TO_FILL_IN = "organization, location, email, contact_person: to be filled in before publication"


def write_json(
    store: Store, path: str | os.PathLike[str], brdf: Brdf | None = None, shared: Shared | None = None
) -> Path:
    """Raises ExportError for a run without readings; warns (ExportWarning) of negative ones, which the schema bars."""
    config = read_config(store.folder)
    samples = load_samples(store)
    s = samples[~samples.saturated]
    if not len(s):
        raise ExportError(f"{store.folder}: has no readings that are values; nothing was written")
    u = s.sigma if shared is None else np.hypot(s.sigma, s.f * shared(s.wi, s.wo))
    if (negative := int((s.f < 0).sum())) > 0:
        warnings.warn(
            f"{negative} negative readings are 0 in the file: BRDF-JSON has none", ExportWarning, stacklevel=2
        )
    n, channels = s.f.shape
    (theta_i, phi_i), (theta_r, phi_r) = to_angles(s.wi), to_angles(s.wo)
    data: dict[str, Any] = {
        name: {"unit": "deg", "values": np.repeat(np.degrees(a) % 360, channels).round(9).tolist()}
        for name, a in (("theta_i", theta_i), ("phi_i", phi_i), ("theta_r", theta_r), ("phi_r", phi_r))
    }
    for name in ("phi_i", "phi_r"):  # what rounding makes 360 is 0
        data[name]["values"] = [v % 360 for v in data[name]["values"]]
    data["BRDF"] = {"unit": "1/sr", "values": np.maximum(s.f, 0).ravel().tolist()}
    parts = "noise" if shared is None else "noise and what all readings share"
    data["uBRDF"] = {"unit": "1/sr", "values": u.ravel().tolist(), "comments": f"k = 1; {parts}"}
    data |= _channels(config.material.channels, n)
    p = store.get("provenance", {})
    simulated = bool(p.get("simulated"))
    metadata = {
        "schema": SCHEMA,
        "id": f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_URL, str(p.get('started')) + config.material.name)}",
        "type": "BRDF",
        "timestamp": p.get("started") or time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "provenance": {"comments": "; ".join([TO_FILL_IN, *lines(about(config.material))])},
        "method": "simulation" if simulated else "measurement",
        "instrumentation": {"name": _instrument(config)},
        "software": {"name": "gonio", "version": gonio.__version__},
        "sample": {"name": config.material.name, "properties_symmetry": config.material.symmetry},
        "environment": "NA",
    }
    write_text(path, json.dumps({"metadata": metadata, "data": data}))
    return Path(path)


def _channels(names: tuple[str, ...], n: int) -> dict[str, Any]:
    """Each row's wavelength, where all channels are named by one; else its channel by name."""
    found = [re.fullmatch(r"(\d{3,4}(?:\.\d+)?)\s*(?:nm)?", name) for name in names]
    if all(found):
        nm = [float(m[1]) for m in found if m]
        return {"wavelength_i": {"unit": "nm", "values": nm * n}}
    channel = {"description": "channel of the detector", "unit": "", "type": "string", "values": list(names) * n}
    return {"adhoc_variables": {"channel": channel}}


def _instrument(config) -> str:
    if config.imported is not None:
        return f"imported from {', '.join(config.imported.files[:3])}"
    return f"rig {config.rig.name}"
