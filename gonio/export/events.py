"""The measurements of a run in the event model of bluesky, as its tools and Tiled read them.

A line of JSON is `[name, document]`: one `start`, one `descriptor` of the stream `primary`, an `event` a measurement,
one `stop`, as suitcase-jsonl writes them (https://blueskyproject.io/event-model, "Documents"; schemas of event-model
1.2x). The same run gives the same documents, uids included.
"""

import calendar
import json
import os
import time
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from gonio.atomic import replacing
from gonio.brdf import Brdf
from gonio.export.about import About
from gonio.export.intervals import Shared
from gonio.geometry import to_angles
from gonio.run.record.config import read_config
from gonio.run.record.store import Store

ANGLES = ("theta_i_deg", "phi_i_deg", "theta_o_deg", "phi_o_deg")


def write_events(
    store: Store,
    path: str | os.PathLike[str],
    brdf: Brdf | None = None,
    shared: Shared | None = None,
    about: About | None = None,
) -> Path:
    """All readings that gave a value, in the order of their making; how many gave none is in the `start` document.

    A BRDF has no place in it. Times are those of the run's begin plus the seconds it was worked on since.
    """
    path = Path(path)
    with replacing(path) as stream:
        for name, document in documents(store, about or {}):
            stream.write(json.dumps([name, document], ensure_ascii=False, allow_nan=False).encode() + b"\n")
    return path


def documents(store: Store, about: About) -> Iterator[tuple[str, dict[str, Any]]]:
    """(name, document) of a run, `start` first, `stop` last."""
    config, p, m = read_config(store.folder), store.get("provenance", {}), store.measured()
    began = float(calendar.timegm(time.strptime(p["started"], "%Y-%m-%dT%H:%M:%SZ"))) if "started" in p else 0.0
    namespace = uuid.uuid5(
        uuid.NAMESPACE_URL, f"gonio:{p.get('host')}:{store.folder.resolve().name}:{p.get('started')}"
    )
    uid = lambda what: str(uuid.uuid5(namespace, what))
    good = np.flatnonzero(np.isfinite(m.f).all(1) & np.isfinite(m.sigma).all(1)) if len(m.id) else np.zeros(0, int)
    good = good[np.argsort(m.wall_s[good], kind="stable")]
    sample = {key.removeprefix("metadata."): value for key, value in about.items() if key not in ("operator", "notes")}
    yield (
        "start",
        {
            "uid": uid("start"),
            "time": began,
            "plan_name": "scan" if "scan" in p else "acquire",
            "plan_type": "generator",
            "detectors": [_detector(config.rig.detector)],
            "motors": list(config.rig.axis_names),
            "num_points": len(good),
            "not_measured": len(m.id) - len(good),
            "sample": sample,
            **{key: about[key] for key in ("operator", "notes") if key in about},
            "rig": config.rig.name,
            "simulated": bool(p.get("simulated")),
            "channels": list(config.material.channels),
            "versions": {"gonio": p.get("gonio", ""), "numpy": p.get("numpy", "")},
            "seed": config.material.seed,
            "hints": {"dimensions": [[[name], "primary"] for name in ("theta_i_deg", "theta_o_deg")]},
        },
    )
    yield "descriptor", _descriptor(uid, began, config.rig.name, config.material.channels)
    angles = [np.degrees(a) for k in (0, 3) for a in to_angles(m.seen[good, k : k + 3])]
    for n, row in enumerate(good.tolist()):
        at = began + float(m.wall_s[row])
        data = {name: float(angle[n]) for name, angle in zip(ANGLES, angles)}
        data |= {"f": m.f[row].tolist(), "sigma": m.sigma[row].tolist()}
        data |= {"saturated": bool(m.saturated[row]), "rig_s": float(m.rig_s[row]), "measurement": int(m.id[row])}
        yield (
            "event",
            {
                "uid": uid(f"event {int(m.id[row])}"),
                "descriptor": uid("primary"),
                "seq_num": n + 1,
                "time": at,
                "data": data,
                "timestamps": dict.fromkeys(data, at),
                "filled": {},
            },
        )
    ended = store.get("ended", "")
    yield (
        "stop",
        {
            "uid": uid("stop"),
            "run_start": uid("start"),
            "time": began + float(m.wall_s.max(initial=0.0)),
            "exit_status": "success" if ended else "abort",
            "reason": ended or "not ended yet",
            "num_events": {"primary": len(good)},
        },
    )


def _descriptor(uid, began: float, rig: str, channels: tuple[str, ...]) -> dict[str, Any]:
    source = f"gonio:{rig}"
    one = {"source": source, "dtype": "number", "shape": []}
    each = {"source": source, "dtype": "array", "shape": [len(channels)], "units": "1/sr"}
    keys: dict[str, dict[str, Any]] = {name: {**one, "units": "deg"} for name in ANGLES}
    keys |= {"f": dict(each), "sigma": dict(each)}
    keys |= {"saturated": {**one, "dtype": "boolean"}, "rig_s": {**one, "units": "s"}}
    keys |= {"measurement": {**one, "dtype": "integer"}}
    return {
        "uid": uid("primary"),
        "run_start": uid("start"),
        "time": began,
        "name": "primary",
        "data_keys": {name: {**key, "object_name": "rig"} for name, key in keys.items()},
        "object_keys": {"rig": list(keys)},
        "configuration": {"rig": {"data": {}, "timestamps": {}, "data_keys": {}}},
        "hints": {"rig": {"fields": ["f"]}},
    }


def _detector(section: object) -> str:
    """Its name: `photodiode`, `camera`, or the driver of a section."""
    return section if isinstance(section, str) else str(getattr(section, "driver", "detector"))
