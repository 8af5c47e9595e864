"""Which mirror poses tell most: D-optimal for the parameters that are still open (Fedorov 1972; Atkinson & Donev 1992).

    gain(c) = log det C_S - log det C_S|c,   C_S the covariance of the open parameters S

C_S|c is what it becomes when pose c is observed with the usual sigma; picks are greedy, each knowing the ones before.
"""

from dataclasses import dataclass

import numpy as np

from calibration.geometry.fit import Fit
from gonio.geometry import Array, half_vector, reflect, unit
from gonio.rig.kinematics.base import Kinematics
from gonio.rig.motion.envelope import Envelope

STEP = 1e-5  # rad or arm lengths, of numerical derivatives
OFTEN = 50  # observations of each candidate, which are as good as a mirror can do
ROOM, FAR, AWAY = np.radians([2.0, 20.0, 1.0])  # searched about a pose; joints' way for it; and from limits
GRAZING = np.cos(np.radians(80))


@dataclass(frozen=True)
class Candidates:
    """Encoder poses (N, A) that show a mirror's peak, with every axis from below but those `down` (N, A), and how the
    peak moves with each parameter: jacobian (N, 3, P) of the half vector less the normal."""

    poses: Array
    down: np.ndarray
    jacobian: Array


def candidates(fit: Fit, envelope: Envelope, mirror: int, n: int, rng: np.random.Generator) -> Candidates:
    """Random poses within the envelope of the rig as fitted that show mirror `mirror`."""
    q = fit.parameters
    normal = q.normal(fit.p, mirror)
    theta, phi = np.radians(80) * np.sqrt(rng.random(n)), rng.uniform(-np.pi, np.pi, n)
    local = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
    wi = unit(local @ _frame(normal).T)
    wo = reflect(wi, np.broadcast_to(normal, wi.shape))
    poses, allowed = envelope.fit(fit.kinematics.inverse(wi, wo, np.zeros(len(q.config.axis_names))))
    up = (wi[:, 2] > GRAZING) & (wo[:, 2] > GRAZING)
    clear = envelope.separation(poses) > envelope.stay_out + np.radians(3)  # room to search about it
    ok = allowed & up[:, None] & clear & np.isfinite(poses).all(-1)
    rows, branches = np.nonzero(ok)
    chosen = rng.permutation(len(rows))[:n]
    poses, wi, wo = poses[rows[chosen], branches[chosen]], wi[rows[chosen]], wo[rows[chosen]]
    roomy = _room_about(fit.kinematics, envelope, poses, wi, wo)
    poses = poses[roomy]
    down = np.zeros(poses.shape, bool)
    which = rng.integers(0, 2 * poses.shape[1], len(poses))  # half of them with one axis from above
    from_above = np.flatnonzero(which < poses.shape[1])
    down[from_above, which[from_above]] = True
    return Candidates(poses, down, jacobian(fit, poses, down, mirror))


def _room_about(kinematics: Kinematics, envelope: Envelope, poses: Array, wi: Array, wo: Array) -> np.ndarray:
    """At which poses (N, A) the detector can look ROOM beside wo to all sides by small moves within the limits."""
    near = np.zeros(poses.shape[1])
    ok = np.ones(len(poses), bool)
    x = unit(np.cross(wo, np.eye(3)[np.abs(wo).argmin(1)]))
    for aside in (x, -x, np.cross(wo, x), -np.cross(wo, x)):
        ways = kinematics.inverse(wi, unit(wo + ROOM * aside), near)
        ways = ways + 2 * np.pi * np.rint((poses[:, None] - ways) / (2 * np.pi))
        moved = np.abs(ways - poses[:, None]).max(-1)
        k = np.nanargmin(np.where(np.isfinite(moved), moved, np.inf), 1)
        there = ways[np.arange(len(poses)), k]
        ok &= (moved[np.arange(len(poses)), k] < FAR) & envelope.inside(there - AWAY) & envelope.inside(there + AWAY)
    return ok


def jacobian(fit: Fit, poses: Array, down: np.ndarray, mirror: int) -> Array:
    """d(half vector - normal)/dp at poses (N, A): (N, 3, P), by differences."""
    q = fit.parameters

    def seen(p: Array) -> Array:
        wi, wo = q.kinematics(p).forward(poses + down * q.of(p, "backlash"))
        return half_vector(wi, wo) - q.normal(p, mirror)

    each = [(seen(fit.p + step) - seen(fit.p - step)) / (2 * STEP) for step in STEP * np.eye(len(q))]
    return np.stack(each, -1)


def best(fit: Fit, at: Candidates, sigma: float, goal: Array, n: int) -> np.ndarray:
    """Indices (n,) of the candidates to visit. goal (P,): sigma at which a parameter is no longer open."""
    c = fit.covariance
    picks: list[int] = []
    for _ in range(n):
        wanted = np.sqrt(np.diag(c)) > goal
        if not wanted.any():
            wanted[:] = True
        gain = _gains(c, at.jacobian, sigma, np.flatnonzero(wanted))
        gain[picks] = -np.inf
        picks.append(int(gain.argmax()))
        j = at.jacobian[picks[-1]]
        c = c - c @ j.T @ np.linalg.solve(j @ c @ j.T + sigma**2 * np.eye(3), j @ c)
    return np.array(picks)


def at_best(fit: Fit, at: Candidates, sigma: float) -> Array:
    """The sigmas (P,) that this mirror could lead to, if all candidates were observed often."""
    told = np.einsum("nik,nil->kl", at.jacobian, at.jacobian) * (OFTEN / sigma**2 / max(len(at.poses) / 100, 1))
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(np.linalg.inv(fit.covariance) + told))))


def _gains(c: Array, jacobian: Array, sigma: float, open_: np.ndarray) -> Array:
    """log det gain (N,) of the open parameters' covariance for each candidate."""
    across = np.einsum("ij,nkj->nik", c, jacobian)  # (N, P, 3)
    noise = np.einsum("nkj,njl->nkl", jacobian, across) + sigma**2 * np.eye(3)
    part = across[:, open_]
    told = np.linalg.solve(c[np.ix_(open_, open_)], part.transpose(1, 0, 2).reshape(len(open_), -1))
    told = told.reshape(len(open_), len(jacobian), 3).transpose(1, 0, 2)
    less = np.einsum("nsk,nsl->nkl", part, told)
    return np.asarray(np.linalg.slogdet(noise)[1] - np.linalg.slogdet(noise - less)[1])


def _frame(normal: Array) -> Array:
    """Columns x, y and the normal (3, 3)."""
    x = unit(np.cross(normal, np.eye(3)[int(np.abs(normal).argmin())]))
    return np.stack([x, np.cross(normal, x), normal], 1)
