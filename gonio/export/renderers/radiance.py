"""Any `Brdf` as Radiance's BSDF XML: Klems' full basis, or a tensor tree, by Radiance's own tools (extra `radiance`).

pab Mountain files -> pabopto2bsdf (an interpolant, Ward et al. 2014) -> bsdf2klems or bsdf2ttree -> wrapBSDF. checkBSDF
then says which reflectance Radiance finds in the file. The tools come with the wheel `pyradiance` and need each other
on PATH, and their library on RAYPATH.
"""

import os
import re
import subprocess
import tempfile
import warnings
from pathlib import Path

import numpy as np

from gonio.atomic import replacing
from gonio.brdf import Brdf
from gonio.evaluate import directions
from gonio.export import ExportError, ExportWarning
from gonio.export.exchange.lattice import AWAY, NOTABLE, reflectances
from gonio.export.extra import needs
from gonio.export.mountain import RGB_TO_XYZ, THETA_I_DEG, write_mountain
from gonio.export.profile import turns
from gonio.geometry import Array

KLEMS_SAMPLES = "100"  # of each pair of patches; Radiance's own 1000 take ten times as long
KLEMS_THETA = np.array([0, 5, 15, 25, 35, 45, 55, 65, 75, 90.0])  # bounds of the full basis's rings, degrees
KLEMS_PHIS = np.array([1, 8, 16, 20, 24, 24, 24, 16, 12])
ANISOTROPIC_THETA_DEG = (8.0, 30.0, 55.0, 78.0)  # incidences; a transport plan between neighbours takes seconds
ANISOTROPIC_PHI_DEG = tuple(np.arange(20.0, 360.0, 60.0))
ANISOTROPIC_DEPTH = "4"  # 16 x 16 directions a hemisphere; each more takes sixteen times as long
LONGEST_S = 3600


def write_klems(brdf: Brdf, path: str | os.PathLike) -> None:
    """Klems' full basis, 145 patches a side: what annual simulations read. See `write_ttree` for what is raised.

    Warns (ExportWarning) of the energy that patches of 10 degrees cannot keep in its place.
    """
    if (lost := _lost_to_patches(brdf)) > NOTABLE:
        line = f"the patches of Klems' basis put at least {lost:.1%} of the reflected energy in the wrong place"
        warnings.warn(line, ExportWarning, stacklevel=2)
    _write(brdf, Path(path), ["bsdf2klems", "-p", "-n", KLEMS_SAMPLES])


def write_ttree(brdf: Brdf, path: str | os.PathLike) -> None:
    """A tensor tree, which is finer where the lobe is; of rank 3 (isotropic) or 4. Luminance alone: rtrace 6 shows the
    colours that bsdf2ttree writes as red (tests/export/test_radiance.py), those of Klems' basis are right.

    Warns (ExportWarning) of the reflectance that Radiance finds beside our own. Raises MissingExtra without pyradiance,
    ExportError for other than 1 or 3 channels, or where a tool of Radiance's fails.
    """
    if brdf.channels == 3:
        line = "the tensor tree holds luminance alone; Radiance reads colours right in `--format klems`"
        warnings.warn(line, ExportWarning, stacklevel=2)
        brdf = Luminance(brdf)
    _write(brdf, Path(path), ["bsdf2ttree", "-p", *(["-g", ANISOTROPIC_DEPTH] if turns(brdf) else [])])


class Luminance:
    """The luminance of a BRDF of linear sRGB channels."""

    channels = 1

    def __init__(self, brdf: Brdf):
        self._brdf = brdf
        self.sample, self.pdf = brdf.sample, brdf.pdf

    def eval(self, wi: Array, wo: Array) -> Array:
        return self._brdf.eval(wi, wo) @ RGB_TO_XYZ[1][:, None]


def _write(brdf: Brdf, path: Path, convert: list[str]) -> None:
    tools = Tools()
    anisotropic = turns(brdf)
    if anisotropic:
        lights = len(ANISOTROPIC_THETA_DEG) * len(ANISOTROPIC_PHI_DEG)
        line = f"anisotropic: Radiance interpolates between {lights} incidences, which is coarse"
        warnings.warn(line, ExportWarning, stacklevel=3)
    with tempfile.TemporaryDirectory() as folder:
        angles = (ANISOTROPIC_THETA_DEG, ANISOTROPIC_PHI_DEG) if anisotropic else (THETA_I_DEG, (0.0,))
        files = write_mountain(brdf, Path(folder), angles[0], phi_i_deg=angles[1])
        interpolant = Path(folder) / "gonio.sir"
        interpolant.write_bytes(
            tools.run(["pabopto2bsdf", "-n", str(os.cpu_count() or 1), *(f.name for f in files)], folder)
        )
        xml = tools.run([*convert, interpolant.name], folder)
        if not xml.rstrip().endswith(b"</WindowElement>"):
            raise ExportError(f"{convert[0]} made no whole XML file; nothing was written")
        with replacing(path) as stream:
            stream.write(xml)
        (Path(folder) / "made.xml").write_bytes(xml)
        theirs = tools.reflectance(Path(folder) / "made.xml")
    ours = reflectances(brdf, np.radians(np.arange(0, 81, 10.0)))
    luminance = float((ours @ RGB_TO_XYZ[1] if brdf.channels == 3 else ours[:, 0]).max())
    line = f"Radiance finds a largest reflectance of {theirs:.1%} in it, gonio {luminance:.1%} in the BRDF (luminance)"
    warnings.warn(line, ExportWarning, stacklevel=3)


class Tools:
    """Radiance's programs, where the wheel put them. Raises MissingExtra."""

    def __init__(self) -> None:
        home = Path(needs("pyradiance", "radiance").__file__).parent
        self._bin, library = home / "bin", home / "lib"
        path = os.pathsep.join([str(self._bin), os.environ.get("PATH", "")])
        self.env = {**os.environ, "PATH": path, "RAYPATH": os.pathsep.join([".", str(library)])}

    def run(self, command: list[str], folder: str | os.PathLike, stdin: bytes = b"") -> bytes:
        """What the program writes. Raises ExportError with its own last line."""
        words = [str(self._bin / command[0]), *command[1:]]
        try:
            done = subprocess.run(words, cwd=folder, env=self.env, input=stdin, capture_output=True, timeout=LONGEST_S)
        except (OSError, subprocess.TimeoutExpired) as e:
            raise ExportError(f"{command[0]}: {e}; nothing was written") from None
        if done.returncode != 0:
            said = done.stderr.decode("utf-8", "replace").strip().split("\n")[-1]
            raise ExportError(f"{command[0]}: {said[:200] or f'exit code {done.returncode}'}; nothing was written")
        return done.stdout

    def reflectance(self, xml: Path) -> float:
        """The largest directional reflectance that checkBSDF finds, of the side that reflects."""
        text = self.run(["checkBSDF", xml.name], xml.parent).decode("utf-8", "replace")
        found = re.findall(r"^(?:Interior|Exterior) Refl.*?([\d.]+)%", text, re.M)
        return max((float(v) for v in found), default=float("nan")) / 100


def _lost_to_patches(brdf: Brdf) -> float:
    """The energy error of f averaged over each outgoing patch, the incidences left as they are: a lower bound."""
    errors = []
    for wi, wo, weight, _ in directions(6000, theta_i=AWAY):
        patch = _patch(wo)
        share = (weight * wo[:, 2])[:, None]
        f = brdf.eval(wi, wo)
        total, area = np.zeros((145, f.shape[1])), np.zeros((145, 1))
        np.add.at(total, patch, f * share)
        np.add.at(area, patch, share)
        mean = (total / np.maximum(area, 1e-300))[patch]
        errors.append(np.sum(np.abs(mean - f) * share, 0) / np.sum(f * share, 0))
    return float(np.mean(errors))


def _patch(wo: Array) -> Array:
    """Number of the patch that each direction lies in."""
    theta = np.degrees(np.arctan2(np.hypot(wo[:, 0], wo[:, 1]), wo[:, 2]))
    ring = np.clip(np.searchsorted(KLEMS_THETA, theta, "right") - 1, 0, 8)
    phis = KLEMS_PHIS[ring]
    step = np.floor((np.arctan2(wo[:, 1], wo[:, 0]) / (2 * np.pi) + 0.5 / phis) % 1 * phis).astype(int)
    return np.concatenate([[0], np.cumsum(KLEMS_PHIS)])[ring] + np.minimum(step, phis - 1)
