"""All measurements of a run as an xarray Dataset."""

from typing import TYPE_CHECKING

import numpy as np

from gonio.config.material import Material
from gonio.export.about import about
from gonio.export.extra import needs
from gonio.geometry import to_angles
from gonio.run.record.store import Store

if TYPE_CHECKING:
    import xarray


def dataset(store: Store, material: Material) -> "xarray.Dataset":
    """Dimensions `sample` (the measurements' numbers), `channel` (by name), `axis` (x, y, z).

    f, sigma (sample, channel) in 1/sr without the cosine, NaN where nothing could be measured; wi, wo (sample, axis) as
    achieved; theta_i_deg … phi_o_deg, saturated, rig_s, wall_s (sample). Attributes: the run, its rig, seed, versions.
    Raises MissingExtra.
    """
    xarray = needs("xarray", "notebook")
    m = store.measured()
    shape = (len(m.id), len(material.channels))
    f, sigma = (a if len(m.id) else np.empty(shape) for a in (m.f, m.sigma))
    (theta_i, phi_i), (theta_o, phi_o) = (to_angles(m.seen[:, k : k + 3]) for k in (0, 3))
    degrees = {"theta_i_deg": theta_i, "phi_i_deg": phi_i, "theta_o_deg": theta_o, "phi_o_deg": phi_o}
    per_sr, seconds = {"units": "sr-1"}, {"units": "s"}
    variables = {
        "f": (("sample", "channel"), f, {**per_sr, "long_name": "BRDF, cosine not included"}),
        "sigma": (("sample", "channel"), sigma, {**per_sr, "long_name": "standard deviation of f"}),
        "wi": (("sample", "axis"), m.seen[:, :3]),
        "wo": (("sample", "axis"), m.seen[:, 3:]),
        **{k: ("sample", np.degrees(a), {"units": "degree"}) for k, a in degrees.items()},
        "saturated": ("sample", m.saturated),
        "rig_s": ("sample", m.rig_s, {**seconds, "long_name": "rig time it took"}),
        "wall_s": ("sample", m.wall_s, {**seconds, "long_name": "since the run began"}),
    }
    p = store.get("provenance", {})
    known = {k: str(v) if isinstance(v, bool) else v for k, v in about(material).items()}
    known |= {"symmetry": material.symmetry, "run": str(store.folder)}
    known |= {k: p[k] for k in ("gonio", "rig", "depth", "seed", "truth", "started") if k in p}
    coordinates = {"sample": m.id, "channel": list(material.channels), "axis": ["x", "y", "z"]}
    return xarray.Dataset(variables, coordinates, known)
