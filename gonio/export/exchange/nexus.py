"""A run's readings as HDF5 in the layout of NeXus (manual.nexusformat.org: NXentry, NXdata, NXsample, NXinstrument).

`/entry/data` is the default: `f` (readings, channels) in 1/sr with `f_errors`, angles in degrees, vectors `wi`, `wo`.
"""

import os
from pathlib import Path

import numpy as np

import gonio
from gonio.atomic import beside
from gonio.brdf import Brdf
from gonio.export.about import about
from gonio.export.extra import needs
from gonio.export.intervals import Shared, columns
from gonio.geometry import to_angles
from gonio.run.record.config import dump, read_config
from gonio.run.record.store import Store


def write_nexus(
    store: Store, path: str | os.PathLike[str], brdf: Brdf | None = None, shared: Shared | None = None
) -> Path:
    """Whole or not at all. Raises MissingExtra without h5py."""
    h5py = needs("h5py", "study")
    config, m, p = read_config(store.folder), store.measured(), store.get("provenance", {})
    wi, wo = m.seen[:, :3], m.seen[:, 3:]
    (theta_i, phi_i), (theta_o, phi_o) = to_angles(wi), to_angles(wo)
    with beside(path) as part, h5py.File(part, "w") as file:
        file.attrs.update(default="entry", creator="gonio", NX_class="NXroot")
        entry = _group(file, "entry", "NXentry", default="data")
        entry["title"], entry["start_time"] = config.material.name, p.get("started", "")
        entry["definition_local"] = "readings of a gonioreflectometer"
        data = _group(entry, "data", "NXdata", signal="f", axes=["reading", "channel"])
        data["reading"], data["channel"] = m.id, list(config.material.channels)
        _field(data, "f", m.f, "1/sr", "BRDF, cosine not included")
        _field(data, "f_errors", m.sigma, "1/sr", "standard deviation (k = 1); 0 where there is no noise")
        for name, angle in (("theta_i", theta_i), ("phi_i", phi_i), ("theta_o", theta_o), ("phi_o", phi_o)):
            _field(data, name, np.degrees(angle), "degree", "as achieved")
        _field(data, "wi", wi, "", "unit vector to the light, z along the normal")
        _field(data, "wo", wo, "", "unit vector to the detector")
        data["saturated"] = m.saturated
        for name, values in columns(brdf, wi, wo, shared):
            data[name] = values
        sample = _group(entry, "sample", "NXsample")
        sample["name"], sample["symmetry"] = config.material.name, config.material.symmetry
        for key, value in about(config.material).items():
            if key != "name":
                sample[key.replace("metadata.", "metadata_")] = value
        instrument = _group(entry, "instrument", "NXinstrument")
        instrument["name"] = str(p.get("rig", ""))
        process = _group(entry, "process", "NXprocess")
        process["program"], process["version"] = "gonio", gonio.__version__
        note = _group(process, "config", "NXnote")
        note["type"], note["data"] = "application/x-yaml", dump(config)
    return Path(path)


def _group(parent, name: str, kind: str, **attributes):
    group = parent.create_group(name)
    group.attrs["NX_class"] = kind
    group.attrs.update(attributes)
    return group


def _field(group, name: str, values: np.ndarray, units: str, says: str) -> None:
    field = group.create_dataset(name, data=values)
    field.attrs["long_name"] = says
    if units:
        field.attrs["units"] = units
