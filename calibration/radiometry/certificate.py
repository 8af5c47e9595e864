"""A white reference's f by angles. Real standards differ from Lambert by up to a fifth at high angles: one number is
that of one geometry.

As a table: CSV with columns theta_i_deg, theta_o_deg, phi_deg (between the two azimuths, 180 = opposite each other) and
f, or f1, f2, ... one a channel, in 1/sr; `u` is the relative standard uncertainty (k = 1) of a row.
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration.rows import number, read_rows
from gonio.geometry import Array, from_angles, unit
from gonio.rig.errors import CalibrationMissing

HOLE = "fill the hole or leave out the row"
ANGLES = ("theta_i_deg", "theta_o_deg", "phi_deg")
NEAR = np.radians(2.0)  # of an angle of a certificate: whoever cannot show it shows one beside
# f of anything white, 1/sr, and away from grazing: a number above is a reflectance factor or a percentage
HIGHEST, BRIGHTEST, STEEP = 1.5, 0.5, 60.0


@dataclass(frozen=True)
class Certificate:
    """wi, wo (N, 3); f (N, C) in 1/sr; u (N,), relative, k = 1."""

    wi: Array
    wo: Array
    f: Array
    u: Array

    @classmethod
    def of_one(cls, theta_i_deg: float, theta_o_deg: float, f: Array, u: float) -> "Certificate":
        """One geometry, light and detector opposite each other."""
        wi, wo = from_angles(np.radians([theta_i_deg]), 0.0), from_angles(np.radians([theta_o_deg]), np.pi)
        return cls(wi, wo, np.atleast_2d(np.asarray(f, float)), np.array([u]))

    def part(self, which: Array) -> "Certificate":
        return Certificate(self.wi[which], self.wo[which], self.f[which], self.u[which])

    @property
    def digest(self) -> str:
        """Of what was said: two references differ in it."""
        parts = (a.round(9).tobytes() for a in (self.wi, self.wo, self.f, self.u))
        return hashlib.sha256(b"".join(parts)).hexdigest()[:12]

    def confirm_channels(self, channels: int) -> None:
        """Raises CalibrationMissing where its f is of other channels than a detector's."""
        said = self.f.shape[1]
        if said not in (1, channels):
            raise CalibrationMissing(f"radiometry: the certificate has {said} channels, the detector {channels}")

    @property
    def used(self) -> Array:
        """Indices that a calibration uses; the others are left to verify it."""
        return np.arange(len(self.f)) if len(self.f) < 4 else np.arange(0, len(self.f), 2)

    @property
    def unused(self) -> Array:
        return np.setdiff1d(np.arange(len(self.f)), self.used)


def within_reach(certificate: Certificate, reachable: Callable[[Array, Array], Array]) -> tuple[Certificate, Array]:
    """The certificate with directions moved by up to NEAR where a rig cannot show them as they are, and which rows (N,)
    it can show then. An arm whose axes are not square looks past the normal by as much: of white that is no matter."""
    wi, wo = certificate.wi.copy(), certificate.wo.copy()
    ok = np.asarray(reachable(wi, wo)).copy()
    turn = 2 * np.pi * np.arange(8) / 8
    for r in np.linspace(0, NEAR, 5)[1:]:
        aside = r * np.stack([np.cos(turn), np.sin(turn), 0 * turn], -1)
        for k in np.flatnonzero(~ok):
            moved_i, moved_o = unit(certificate.wi[k] + aside), unit(certificate.wo[k] + aside)
            for a, b in (
                (np.broadcast_to(wi[k], moved_o.shape), moved_o),
                (moved_i, np.broadcast_to(wo[k], moved_i.shape)),
            ):
                if (found := np.flatnonzero(reachable(a, b))).size:
                    wi[k], wo[k], ok[k] = a[found[0]], b[found[0]], True
                    break
    return Certificate(wi, wo, certificate.f, certificate.u), ok


def read_certificate(path: Path, u: float) -> Certificate:
    """The table of a CSV file; u where a row says none. Raises CalibrationMissing that names file, line and column."""
    table, unsure = [], []
    values: tuple[str, ...] = ()
    for where, row in read_rows(path, ANGLES, f"{', '.join(ANGLES)} and f (or f1, f2, ...)"):
        values = values or tuple(n for n in row if n and (n == "f" or (n[:1] == "f" and n[1:].isdigit())))
        if not values:
            raise CalibrationMissing(f"{path}:1: no column f; give f, or f1, f2, ... one a channel, in 1/sr")
        table.append([number(row, c, where, HOLE) for c in (*ANGLES, *values)])
        unsure.append(number(row, "u", where, HOLE) if row.get("u") else u)
        if not (0 <= table[-1][0] < 90 and 0 <= table[-1][1] < 90):
            raise CalibrationMissing(f"{where}: an angle from the normal lies outside 0 ... 90 degrees")
        if not all(0 < v < HIGHEST for v in table[-1][3:]):
            raise CalibrationMissing(f"{where}: f must lie between 0 and {HIGHEST:g} 1/sr; a white one is about 0.31")
        if max(table[-1][:2]) < STEEP and max(table[-1][3:]) > BRIGHTEST:
            raise CalibrationMissing(
                f"{where}: f of {max(table[-1][3:]):g} 1/sr reflects more than falls on it; a reflectance is pi times f"
            )
        if not 0 <= unsure[-1] < 1:
            raise CalibrationMissing(f"{where}: u is {unsure[-1]:g}; give a relative standard uncertainty below 1")
    if not table:
        raise CalibrationMissing(f"{path}: no row; give one angle at least")
    t = np.array(table)
    theta_i, theta_o, phi = np.radians(t[:, :3]).T
    return Certificate(from_angles(theta_i, 0.0), from_angles(theta_o, phi), t[:, 3:], np.array(unsure))
