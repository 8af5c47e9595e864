"""Whether a calibrated rig can be believed: what must hold of any matt sample, and of one whose f is known.

Each check measures by the rig's own `visit`, as a run does; its figure is a share of f, its limit holds where noise
does not hide it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calibration.radiometry.certificate import Certificate
from gonio.geometry import Array, from_angles
from gonio.rig.staged import StagedRig

LIMIT = 0.01  # of f
VAGUE = 3.0  # times a limit: who is no surer than this cannot tell
REPEATS = 6  # measurements of one pair
PAIRS, TURNS, DIRECTIONS = 12, 12, 48
ENERGY_AT = (20.0, 45.0, 65.0)  # degrees


@dataclass(frozen=True)
class Check:
    """value, its uncertainty (k = 2) and the limit, all relative; NaN where it could not be made, and why."""

    name: str
    value: float
    unsure: float
    limit: float
    why: str = ""

    @property
    def passed(self) -> bool | None:
        """None: not made, or too unsure to tell."""
        if not np.isfinite(self.value) or (self.unsure > VAGUE * self.limit and self.value <= self.limit + self.unsure):
            return None
        return bool(self.value <= self.limit + self.unsure)

    @property
    def text(self) -> str:
        if self.passed is None and np.isfinite(self.value):
            return (
                f"{self.name:12} cannot tell  {self.value:.2%} ± {self.unsure:.2%}, limit {self.limit:.1%}  {self.why}"
            )
        if self.passed is None:
            return f"{self.name:12} not made: {self.why}"
        word = "holds" if self.passed else "FAILS"
        return (
            f"{self.name:12} {word}  {self.value:.2%} ± {self.unsure:.2%}, limit {self.limit:.1%}  {self.why}".rstrip()
        )


def verify(
    rig: StagedRig, certificate: Certificate | None, wait: Callable[[], None] | None, say: Callable[[str], None]
) -> list[Check]:
    """All checks on the sample that lies there. wait() lets the time pass after which the first are repeated, None =
    not."""
    if certificate is not None:
        certificate.confirm_channels(rig.channels)
    m = _Measuring(rig)
    say("repeatability")
    first = m.of(*_repeated())
    checks = [_reciprocity(m, say), _isotropy(m, say), _energy(m, say), _standard(m, certificate, say)]
    if wait is None:
        checks.append(Check("repeat", np.nan, np.nan, LIMIT, "asked for no wait"))
    else:
        wait()
        checks.append(_repeat(first, m.of(*_repeated())))
    rig.light.off()
    return checks


def verdict(checks: list[Check]) -> str:
    """In words."""
    failed = [c.name for c in checks if c.passed is False]
    left = [c.name for c in checks if c.passed is None]
    if failed:
        return f"not to be trusted: {', '.join(failed)} " + ("fails" if len(failed) == 1 else "fail")
    made = len(checks) - len(left)
    if not made:
        return "nothing could be checked: see why, or give it wider limits"
    return f"all {made} checks made hold" + (f"; not told: {', '.join(left)}" if left else "")


class _Measuring:
    """f (N, C) and sigma (N, C) of pairs, each the mean of REPEATS; NaN where the rig cannot reach one."""

    def __init__(self, rig: StagedRig):
        self.rig, self._next = rig, 1 << 30

    def of(self, wi: Array, wo: Array, repeats: int = REPEATS) -> tuple[Array, Array]:
        n = len(wi)
        ids = self._next + np.arange(n * repeats)
        self._next += n * repeats
        f = np.full((n, repeats, self.rig.channels), np.nan)
        sigma = f.copy()
        order = np.repeat(np.arange(n), repeats)
        for seen in self.rig.visit(wi[order], wo[order], ids):
            k = seen.ids - ids[0]
            # as achieved, a count beside what was asked for: of a matt sample that is no matter
            f[k // repeats, k % repeats], sigma[k // repeats, k % repeats] = seen.f, seen.sigma
        return f.mean(1), np.sqrt((sigma**2).sum(1)) / repeats


def _reciprocity(m: _Measuring, say) -> Check:
    say("reciprocity")
    rng = np.random.default_rng(1)
    wi, wo = _random(rng, PAIRS), _random(rng, PAIRS)
    (a, sa), (b, sb) = m.of(wi, wo), m.of(wo, wi)
    return _compared("reciprocity", a, b, np.hypot(sa, sb), "f(a, b) against f(b, a), mean of pairs")


def _isotropy(m: _Measuring, say) -> Check:
    say("isotropy")
    turn = 2 * np.pi * np.arange(TURNS) / TURNS
    wi, wo = from_angles(np.full(TURNS, np.radians(40)), turn), from_angles(np.full(TURNS, np.radians(25)), turn + 2.0)
    f, sigma = m.of(wi, wo)
    f, sigma = _good(f, sigma)
    if len(f) < 4:
        return Check("isotropy", np.nan, np.nan, LIMIT, "too few turns of the table are in reach")
    spread = float(np.sqrt(np.mean(f.var(0) / f.mean(0) ** 2)))
    noise = float(np.sqrt(np.mean(sigma**2) / np.mean(f**2)))
    return Check(
        "isotropy", float(np.sqrt(max(spread**2 - noise**2, 0.0))), 2 * noise, LIMIT, "sd under the turning table"
    )


def _energy(m: _Measuring, say) -> Check:
    from scipy.stats import qmc

    from gonio.brdf.models.lambert import cosine_hemisphere

    say("energy")
    most, unsure = -np.inf, 0.0
    wo = cosine_hemisphere(qmc.Sobol(2, seed=0).random(64)[:DIRECTIONS])
    for angle in ENERGY_AT:
        wi = np.broadcast_to(from_angles(np.radians([angle]), 0.0), wo.shape)
        f, sigma = _good(*m.of(wi, wo, 1))
        if len(f) < DIRECTIONS / 2:
            continue
        albedo = np.pi * f.mean(0)
        k = int(albedo.argmax())
        if albedo[k] > most:
            most, unsure = float(albedo[k]), float(2 * np.pi * np.sqrt((sigma[:, k] ** 2).sum()) / len(f))
    if not np.isfinite(most):
        return Check("energy", np.nan, np.nan, LIMIT, "too few directions are in reach")
    return Check("energy", max(most - 1, 0.0), unsure, LIMIT, f"the brightest channel reflects {most:.1%}")


def _standard(m: _Measuring, certificate: Certificate | None, say) -> Check:
    if certificate is None or not len(certificate.unused):
        return Check("standard", np.nan, np.nan, LIMIT, "needs a reference whose table has angles left: --table")
    say("standard")
    rest = certificate.part(certificate.unused)
    f, sigma = m.of(rest.wi, rest.wo)
    known = np.broadcast_to(rest.f, f.shape)
    ok = np.isfinite(f).all(1)
    if not ok.any():
        return Check("standard", np.nan, np.nan, LIMIT, "none of its angles is in reach")
    off = float(np.sqrt(np.mean((f[ok] / known[ok] - 1) ** 2)))
    unsure = float(2 * np.hypot(np.sqrt(np.mean(sigma[ok] ** 2 / known[ok] ** 2)), rest.u.mean()))
    return Check("standard", off, unsure, LIMIT, f"rms at {int(ok.sum())} angles that calibration did not use")


def _repeat(before: tuple[Array, Array], after: tuple[Array, Array]) -> Check:
    return _compared("repeat", before[0], after[0], np.hypot(before[1], after[1]), "after against before")


def _compared(name: str, a: Array, b: Array, sigma: Array, why: str) -> Check:
    """Mean relative difference of pairs (N, C)."""
    ok = np.isfinite(a).all(1) & np.isfinite(b).all(1)
    if ok.sum() < 2:
        return Check(name, np.nan, np.nan, LIMIT, "too few pairs are in reach")
    mean = 0.5 * (a[ok] + b[ok])
    off = float(np.sqrt(np.mean(((a[ok] - b[ok]) / mean) ** 2)))
    noise = float(np.sqrt(np.mean((sigma[ok] / mean) ** 2)))
    return Check(name, float(np.sqrt(max(off**2 - noise**2, 0.0))), 2 * noise, LIMIT, why)


def _good(f: Array, sigma: Array) -> tuple[Array, Array]:
    ok = np.isfinite(f).all(1)
    return f[ok], sigma[ok]


def _repeated() -> tuple[Array, Array]:
    return from_angles(np.radians([0.0, 30.0, 50.0]), 0.0), from_angles(np.radians([45.0, 30.0, 20.0]), 2.5)


def _random(rng: np.random.Generator, n: int) -> Array:
    return from_angles(np.radians(rng.uniform(5, 65, n)), rng.uniform(-np.pi, np.pi, n))
