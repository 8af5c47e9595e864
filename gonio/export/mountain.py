"""Any `Brdf` as the text that pab goniophotometers write and Radiance's pabopto2bsdf and Mountain read.

One file per incidence: `#intheta`, `#inphi` in degrees, then a line `theta phi value ...` per outgoing direction, in
degrees; values are the DSF, f cos(theta_o) in 1/sr: CIE X, Y, Z of a 3-channel (linear sRGB) BRDF, Y of a grey one.
"""

import os
from pathlib import Path

import numpy as np

from gonio.atomic import replacing
from gonio.brdf import Brdf
from gonio.export import ExportError, checked
from gonio.export.about import About, lines
from gonio.export.profile import half_profile, half_width, turns
from gonio.geometry import Array, from_angles, from_height, reflect

THETA_I_DEG = (0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0)
# of a surface that changes as it is turned; off the axes, where pabopto2bsdf cannot tell which quadrant it is
PHI_I_DEG = tuple(np.arange(15.0, 360, 30.0))
UNIFORM, LOBE = 4000, 4000  # outgoing directions over the hemisphere, and more of them about the lobe
RGB_TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
GOLDEN = np.pi * (3 - np.sqrt(5))


def write_mountain(
    brdf: Brdf,
    folder: str | os.PathLike,
    theta_i_deg=THETA_I_DEG,
    name: str = "gonio",
    phi_i_deg=None,
    about: About | None = None,
) -> list[Path]:
    """Write one text file per incidence into `folder` (made if need be) and give their paths.

    phi_i_deg: azimuths of the light; None = 0 alone, or twelve where the BRDF changes as the sample is turned.
    about: what is known of the sample, in comments of each header.

    Raises ExportError for unsorted incidences, or a BRDF with NaN, negative values or other than 1 or 3 channels.
    """
    if brdf.channels not in (1, 3):
        raise ExportError(f"the BRDF has {brdf.channels} channels, the format holds 1 or 3; nothing was written")
    angles = np.asarray(theta_i_deg, float)
    if len(angles) == 0 or np.any(np.diff(angles) <= 0) or angles[0] < 0 or angles[-1] >= 90:
        raise ExportError(f"incidences {list(theta_i_deg)} are not ascending within 0..90 degrees")
    width = half_width(half_profile(brdf, 512, 2))
    tables = []
    if phi_i_deg is None:
        phi_i_deg = PHI_I_DEG if turns(brdf) else (0.0,)
    lights = [(t, p) for t in angles for p in (phi_i_deg if t > 0 else phi_i_deg[:1])]
    for theta, phi in lights:
        wi = from_angles(np.radians(theta), np.radians(phi))
        wo = _directions(wi, width)
        tables.append((wo, checked(brdf, np.broadcast_to(wi, wo.shape), wo) * wo[:, 2:]))
    Path(folder).mkdir(parents=True, exist_ok=True)
    said = "".join(f"#about {line}\n" for line in lines(about or {}))
    names = [f"{name}_{t:04.1f}" + (f"_{p:03.0f}" if len(phi_i_deg) > 1 else "") for t, p in lights]
    heads = [f'#sample_name "{name}"\n{said}'] * len(lights)
    return [_write(Path(folder), n, h, t, p, *table) for n, h, (t, p), table in zip(names, heads, lights, tables)]


def _directions(wi: Array, width: float) -> Array:
    """Outgoing directions: a spiral over the hemisphere, and one over the half vectors of a lobe of this width."""
    k = np.arange(UNIFORM)
    everywhere = from_height(1 - (k + 0.5) / UNIFORM, k * GOLDEN)
    k = np.arange(LOBE)
    t = (k + 0.5) / LOBE
    h = from_angles(np.arctan(2 * width * np.sqrt(t / (1 - t))), k * GOLDEN)
    lobe = reflect(np.broadcast_to(wi, h.shape), h)
    both = np.concatenate([everywhere, lobe[h @ wi > 0]])
    return both[both[:, 2] > 1e-4]


def _write(folder: Path, file: str, head: str, theta_i: float, phi_i: float, wo: Array, dsf: Array) -> Path:
    theta = np.degrees(np.arctan2(np.hypot(wo[:, 0], wo[:, 1]), wo[:, 2]))
    phi = np.degrees(np.arctan2(wo[:, 1], wo[:, 0])) % 360
    colours = "CIE-XYZ" if dsf.shape[1] == 3 else "CIE-Y"
    head += f"#colorimetry: {colours}\n#format: theta phi DSF\n"
    head += "#upphi 90\n"  # Radiance's up is +y, as ours is; without the line it takes +x
    head += f"#intheta {theta_i:.6f}\n#inphi {phi_i:.6f}\n"
    if dsf.shape[1] == 3:
        dsf = dsf @ RGB_TO_XYZ.T
    path = folder / f"{file}.txt"
    lines = [f"{t:.6f} {p:.6f} " + " ".join(f"{v:.8g}" for v in row) for t, p, row in zip(theta, phi, dsf)]
    with replacing(path) as stream:
        stream.write((head + "\n".join(lines) + "\n").encode())
    return path
