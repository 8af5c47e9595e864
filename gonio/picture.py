"""What a picture asks of a material: with which density pairs of directions enter it.

A path tracer's hits on the material give W: a change df of the material changes the picture, pixel by pixel and
relative to the pixel, by the integral of df(wi, wo) W(wi, wo) dwi dwo. Kept are w = W / cos theta_o over (theta_i,
theta_o, |phi_o - phi_i|), mean 1 over the hemispheres, and some of the hits themselves. `gonio scene` makes it
(gonio.render.scene), `sampler.target.scene` measures for it.
"""

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gonio.atomic import replacing
from gonio.geometry import Array, to_angles

BINS = (36, 36, 36)  # theta_i, theta_o over [0, pi/2], phi over [0, pi]
MOST_BYTES = 64 * 2**20


class PictureError(ValueError):
    """A file that is not what `gonio scene` writes: which, why, what to do. One line; exit code 2."""

    exit_code = 2


@dataclass(frozen=True)
class Picture:
    """density BINS: w at the bins' centres. wi, wo (M, 3) and weight (M,), mean 1: hits, so that a sum over them of
    weight x g(wi, wo) / f-free is the integral of g W. share: of the picture's light, what comes off the material."""

    density: Array
    wi: Array
    wo: Array
    weight: Array
    share: float
    name: str

    def __call__(self, wi: Array, wo: Array) -> Array:
        """w (N,) at pairs (N, 3), linear between the centres of bins; 0 is possible."""
        at = [np.clip(x * n - 0.5, 0, n - 1) for x, n in zip(_place(wi, wo), BINS)]
        out = np.zeros(len(wi))
        low = [np.minimum(x.astype(int), n - 2) for x, n in zip(at, BINS)]
        part = [x - k for x, k in zip(at, low)]
        for corner in np.ndindex(2, 2, 2):
            weight = np.prod([p if c else 1 - p for p, c in zip(part, corner)], axis=0)
            out += weight * self.density[tuple(k + c for k, c in zip(low, corner))]
        return out

    def error(self, missed: Array, f: Array) -> float:
        """The share of the light off the material that is wrong in the picture: |f^ - f| (M, C) and f (M, C) at the
        hits; the mean of the channels."""
        w = self.weight[:, None]
        return float(np.mean((w * missed).sum(0) / np.maximum((w * f).sum(0), 1e-300)))

    def save(self, path: str | os.PathLike[str]) -> None:
        with replacing(path) as stream:
            arrays = {k: getattr(self, k).astype(np.float32) for k in ("density", "wi", "wo", "weight")}
            np.savez_compressed(stream, allow_pickle=False, share=self.share, name=self.name, **arrays)


def of_hits(wi: Array, wo: Array, w: Array, share: float, name: str, rng: np.random.Generator, keep: int) -> Picture:
    """Of hits wi, wo (N, 3), to the light and to the eye, whose share of the integral is w (N,). Raises PictureError.

    The density is smoothed by a bin, numerator and solid angle alike, so that a bin at normal incidence, which is next
    to nothing, does not stand out.
    """
    from scipy.ndimage import gaussian_filter

    if len(w) == 0 or not w.sum() > 0:
        raise PictureError(f"{name}: no light comes off the material in this picture; is it in sight, and lit?")
    place = np.stack(_place(wi, wo), 1)
    hit, edges = np.histogramdd(place, BINS, [(0, 1)] * 3, weights=w)
    low, high = (np.pi / 2 * edges[0][k] for k in (slice(None, -1), slice(1, None)))
    solid = np.cos(low) - np.cos(high)
    cosine = (np.cos(2 * low) - np.cos(2 * high)) / 4  # of cos over a ring, what W / cos theta_o divides by
    volume = solid[:, None, None] * cosine[None, :, None] * np.ones(BINS[2])
    volume /= volume.sum()
    density = gaussian_filter(hit, 0.7, mode="nearest") / gaussian_filter(volume, 0.7, mode="nearest")
    density /= (density * volume).sum()
    # one in so many of the sum of weights: what is rare and bright is kept with its neighbours' weight
    some = np.searchsorted(np.cumsum(w), (np.arange(keep) + rng.random()) / keep * w.sum())
    some = np.minimum(some, len(w) - 1)
    return Picture(density, wi[some], wo[some], np.ones(keep), share, name)


def load(path: str | os.PathLike[str]) -> Picture:
    """Raises PictureError."""
    try:
        if Path(path).stat().st_size > MOST_BYTES:
            raise ValueError("it is far too large")
        with np.load(path, allow_pickle=False) as d:
            arrays = {k: np.asarray(_bounded(d, k), float) for k in ("density", "wi", "wo", "weight")}
            found = Picture(share=float(d["share"]), name=str(d["name"]), **arrays)
    except OSError as e:
        raise PictureError(f"{path}: cannot be read ({e.strerror or e}); make it with `gonio scene`") from None
    except Exception as e:  # what a spoilt archive raises is not ours to list
        raise PictureError(f"{path}: not what `gonio scene` writes ({e})".replace("\n", " ")) from None
    good = found.density.shape == BINS and found.wi.shape == found.wo.shape == (len(found.weight), 3)
    finite = all(np.isfinite(a).all() for a in arrays.values())
    if not (good and finite and len(found.weight) and _sound(found)):
        raise PictureError(f"{path}: not what `gonio scene` writes; make it anew")
    return found


def _sound(p: Picture) -> bool:
    """Densities, weights and directions that hits can have."""
    numbers = p.density.min() >= 0 and p.density.max() > 0 and p.weight.min() >= 0 and p.weight.max() > 0
    up = all(w[:, 2].min() > 0 and np.abs(np.linalg.norm(w, axis=1) - 1).max() < 1e-3 for w in (p.wi, p.wo))
    return bool(numbers and up and 0 <= p.share <= 1 + 1e-6)


def _bounded(archive, key: str) -> Array:
    """A member of an archive, unless it says to be larger than the file may be."""
    info = archive.zip.getinfo(f"{key}.npy")
    if info.file_size > MOST_BYTES:
        raise ValueError(f"{key} is far too large")
    return archive[key]


def sha256(path: str | os.PathLike[str]) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def _place(wi: Array, wo: Array) -> tuple[Array, Array, Array]:
    """Where bins are: theta_i, theta_o, |phi| in [0, 1]."""
    (theta_i, phi_i), (theta_o, phi_o) = to_angles(wi), to_angles(wo)
    turned = np.abs((phi_o - phi_i + np.pi) % (2 * np.pi) - np.pi)
    return theta_i / (np.pi / 2), theta_o / (np.pi / 2), turned / np.pi
