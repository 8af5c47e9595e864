"""Is the result good, what is wrong with it, what to do next: in words, before anything else is shown."""

from dataclasses import dataclass, field

import numpy as np

from gonio import picture
from gonio.brdf import Brdf
from gonio.config.material import Material
from gonio.evaluate import directions
from gonio.picture import Picture, PictureError
from gonio.reconstruct.errors import ReconstructionError
from gonio.reconstruct.running import RunningBrdf, fit
from gonio.reconstruct.samples import Samples
from gonio.reconstruct.splines.expected_error import MEAN_OVER_68
from gonio.reconstruct.splines.held_out import EnergyError

DEFAULT_GOAL = 0.03  # energy error
USELESS = 0.3
FASTEST, SLOWEST = 1.0, 0.15  # exponents p of an error that falls as N^-p: beyond, the fit of it is noise
NOTABLE = 0.01  # a share worth a line
CHECKED = 3000
FAR = 30  # times the measurements made: so many more are no advice


@dataclass(frozen=True)
class Verdict:
    """`grade` good, not yet or unusable; error, goal: energy errors; findings: what is wrong, a line each; next: a
    line; more: measurements still to be made for the goal, None where there is no telling."""

    grade: str
    error: float
    goal: float
    more: int | None
    findings: list[str] = field(default_factory=list)
    next: str = ""
    what: str = "energy error"

    @property
    def line(self) -> str:
        words = {"good": "Good", "not yet": "Not yet good enough", "unusable": "Do not use this result"}[self.grade]
        return f"{words}: estimated {self.what} {self.error:.1%}, goal {self.goal:.1%}. {self.next}".rstrip()


def verdict(brdf: Brdf, samples: Samples, material: Material, failed: int = 0, imported: bool = False) -> Verdict:
    """Of a run's BRDF and all its samples in the order of their making; failed: readings that gave no value.

    imported: they come from a file, in its order, which says nothing; nothing can be measured on.
    """
    if imported:
        samples = samples[np.random.default_rng(0).permutation(len(samples))]
    seen = _picture(material)
    goal = (material.stop.energy_error if seen is None else material.stop.scene_error) or DEFAULT_GOAL
    error, slope = _error(brdf, samples, material.symmetry == "anisotropic", seen)
    more = None if slope is None or error <= goal else int(len(samples) * ((error / goal) ** (1 / slope) - 1)) + 1
    grade = "good" if error <= goal else "unusable" if error > USELESS else "not yet"
    words = _next(grade, error, slope, more, len(samples), imported)
    what = "energy error" if seen is None else "error in the picture"
    return Verdict(grade, error, goal, more, _findings(brdf, samples, failed), words, what)


def _picture(material: Material) -> Picture | None:
    """That which the run is for; None of a run for every direction, and where its file is gone."""
    if material.sampler.target.scene is None:
        return None
    try:
        return picture.load(material.sampler.target.scene)
    except PictureError:
        return None


def _next(grade: str, error: float, slope: float | None, more: int | None, n: int, imported: bool) -> str:
    if grade == "good":
        return ""
    if more is None or slope is None:
        return "Import more readings." if imported else "Measure more: `gonio resume RUN --set budget.measurements=N`."
    if more > FAR * n:
        twice = error * 2**-slope
        return f"The error falls slowly, as N^-{slope:.2f}: twice as many measurements would give about {twice:.1%}."
    digits = 10 ** max(int(np.log10(more)) - 1, 0)
    rounded = -(-more // digits) * digits
    if imported:
        return f"About {rounded:,} more readings, spread as these are."
    return f"About {rounded:,} more measurements: `gonio resume RUN --set budget.measurements={n + rounded}`."


def _error(brdf: Brdf, samples: Samples, anisotropic: bool, seen: Picture | None = None) -> tuple[float, float | None]:
    """The estimated energy error of what is delivered, or its error in a picture, and p of its fall as N^-p."""
    history = []
    for part in (0.25, 0.5, 1.0):
        n = int(part * len(samples))
        try:
            history.append((n, fit(samples[:n], anisotropic=anisotropic)))
        except ReconstructionError:
            continue
    if not history:
        return float(getattr(brdf, "energy_error_estimate", 1.0)), None
    slope = None
    if len(history) > 1:
        n, e = np.log([(k, max(_said(r, seen), 1e-6)) for k, r in history]).T
        slope = float(np.clip(-np.polyfit(n, e, 1)[0], SLOWEST, FASTEST))
    if seen is not None:
        return _said(history[-1][1], seen), slope
    estimate = getattr(brdf, "energy_error_estimate", None)
    if estimate is None:  # a model that does not judge itself: at least what it misses at the samples
        estimate = max(_missed(brdf, history[-1][1]), history[-1][1].energy_error_estimate)
    return float(estimate), slope


def _said(running: RunningBrdf, seen: Picture | None) -> float:
    """What a running reconstruction says of its own error."""
    if seen is None:
        return float(running.energy_error_estimate)
    low, high = running.interval(seen.wi, seen.wo)
    return seen.error(MEAN_OVER_68 * 0.5 * (high - low), running.eval(seen.wi, seen.wo))


def _missed(brdf: Brdf, running) -> float:
    """The energy error of `brdf` at the samples of a running reconstruction."""
    p = running.problem
    at = np.random.default_rng(0).permutation(len(p.samples))[:CHECKED]
    s = p.samples[at]
    return EnergyError(p.angles, p.g, p.sigma, running.stretch, at)(brdf.eval(s.wi, s.wo) * s.wo[:, 2:])


def _unseen(brdf: Brdf) -> float:
    """The share of the reflected energy where the standard deviation is above half of f; 0 of a model without one."""
    std = getattr(brdf, "std", None)
    if std is None:
        return 0.0
    shares = []
    for wi, wo, weight, _ in directions(1000):
        energy = brdf.eval(wi, wo) * (weight * wo[:, 2])[:, None]
        shares.append((energy * (std(wi, wo) > 0.5 * brdf.eval(wi, wo))).sum() / max(float(energy.sum()), 1e-300))
    return float(np.mean(shares))


def _findings(brdf: Brdf, samples: Samples, failed: int) -> list[str]:
    notes = getattr(brdf, "notes", {})
    n, found = len(samples), []
    if (unseen := _unseen(brdf)) > NOTABLE:
        found.append(f"{unseen:.0%} of the reflected energy lies where f is known to a factor of two at best: unseen.")
    saturated = int(samples.saturated.sum())
    if saturated:
        found.append(
            f"{saturated} of {n} readings were saturated: what lies above them is lost and not in the estimate."
        )
    if failed > NOTABLE * n:
        found.append(f"{failed} readings gave no value.")
    if (wrong := int(notes.get("outliers", 0))) > NOTABLE * n:
        found.append(f"{wrong} of {n} readings contradict all around them and were left out.")
    if (before := notes.get("mirror_asymmetry", 0.0)) > NOTABLE:
        tilt, azimuth = np.hypot(notes["tilt_x_deg"], notes["tilt_y_deg"]), notes["azimuth_deg"]
        done = f"The two sides of the plane of incidence differed by {before:.1%} of the energy"
        if tilt or azimuth:
            left = notes["mirror_asymmetry_left"]
            done += (
                f"; a tilt of {tilt:.1f}° and an azimuth of {azimuth:.1f}° were found and corrected, {left:.1%} is left"
            )
        found.append(f"{done[0].upper()}{done[1:]}: check how the sample lies, and the zeros of the axes.")
    if (turned := notes.get("turn_asymmetry", 0.0)) > NOTABLE:
        found.append(
            f"Turned by 90° it differs by {turned:.1%} of the energy: it may have a grain (`symmetry: anisotropic`)."
        )
    return found
