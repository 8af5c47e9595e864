"""A render that writes down how a material enters the picture: every hit on it, with both of its directions.

A path is x0 (eye), x1, x2, …; at each vertex on the material the light that arrives, by a draw of a light (next-event
estimation) and by the draw that the path goes on with, is a hit: weight = what it adds to the pixel, over the
material's own f, over the pixel. The two ways share what both can find by multiple importance (Veach 1997, balance
heuristic). The material itself is replaced by a grey diffuse one, whose constant f cancels: how light reaches and
leaves it does not hang on it to the first order; only what it sends to itself by way of others does.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gonio.config import ConfigError
from gonio.geometry import Array
from gonio.picture import Picture, of_hits
from gonio.render.mitsuba import load_mitsuba
from gonio.render.scene.files import put, read_scene

DEPTH = 6  # vertices of a path
KEPT = 4096  # hits in the file
DARK = 0.02  # of the picture's mean: a pixel darker than this counts as one of this


@dataclass(frozen=True)
class Recorded:
    """picture, what `sampler.target.scene` reads; image (H, W, 3) linear, and mask (H, W): the material's own share."""

    picture: Picture
    image: Array
    mask: Array
    hits: int


def record(path: Path, bsdf: str, *, size: int = 128, spp: int = 64, seed: int = 0) -> Recorded:
    """Hits on the BSDF of id `bsdf` in a Mitsuba scene; the film is size pixels wide, of the scene's own shape.

    Raises ConfigError, PictureError; MissingExtra without Mitsuba.
    """
    mi = load_mitsuba()
    if not mi.variant().startswith("llvm"):
        raise ConfigError("gonio scene needs Mitsuba's LLVM variant: install LLVM 19 or newer (Debian: libllvm19)")
    scene = load(put(read_scene(path), bsdf, path, None), path)
    width, height = _film(scene, size)
    paths = _trace(mi, scene, bsdf, width, height, spp, seed)
    image = _pixels(paths.light(), paths.pixel, width * height, spp)
    own, wi, wo, pixel = paths.hits()
    dark = DARK * image.mean()
    weight = (own / (image[pixel] + dark)).mean(1)
    mask = _pixels(own, pixel, width * height, spp) / np.maximum(image, 1e-9)
    share = float((own.sum(0) / np.maximum(image.sum(0) * spp, 1e-300)).mean())
    good = np.isfinite(weight) & (weight > 0)
    name = f"{path.name}, {bsdf}"
    rng = np.random.default_rng(seed)
    picture = of_hits(wi[good], wo[good], weight[good], min(share, 1.0), name, rng, KEPT)
    shape = (height, width, 3)
    return Recorded(picture, image.reshape(shape), np.minimum(mask.reshape(shape).mean(-1), 1), int(good.sum()))


def load(text: str, path: Path):
    """A scene of its XML; files that it names lie beside `path`. Raises ConfigError with Mitsuba's own words."""
    mi = load_mitsuba()
    resolver = mi.file_resolver()
    resolver.prepend(str(path.parent.resolve()))
    try:
        return mi.load_string(text)
    except Exception as e:  # Mitsuba's parser raises RuntimeError, plugins what they like
        raise ConfigError(f"{path}: Mitsuba cannot load it ({str(e).strip()})".replace("\n", " ")) from None


def _film(scene, size: int) -> tuple[int, int]:
    """Width and height of the film that is traced."""
    if len(scene.sensors()) == 0:
        raise ConfigError("the scene has no <sensor>: nobody looks at it")
    across, down = (int(k) for k in scene.sensors()[0].film().size())
    return size, max(1, round(size * down / across))


@dataclass
class _Vertex:
    """One bounce of all paths, (N, …): whether on the material; local directions to the eye, the light drawn, the way
    the path goes on; what the drawn light adds, the factor of the way on, light met next: without what came before."""

    own: Array
    eye: Array
    light: Array
    on: Array
    direct: Array
    factor: Array
    emitted: Array


@dataclass
class _Paths:
    pixel: Array
    seen: Array
    vertices: list[_Vertex]

    def light(self) -> Array:
        """What each path brings to its pixel, (N, 3)."""
        arriving = np.zeros_like(self.seen)
        for v in reversed(self.vertices):
            arriving = v.direct + v.factor * (v.emitted + arriving)
        return self.seen + arriving

    def hits(self) -> tuple[Array, Array, Array, Array]:
        """Of all hits on the material: what they add to the pixel (M, 3), wi to the light and wo to the eye, pixel."""
        before = [np.ones_like(self.seen)]
        for v in self.vertices:
            before.append(before[-1] * v.factor)
        arriving = np.zeros_like(self.seen)
        parts = []
        for v, reached in zip(reversed(self.vertices), reversed(before[:-1])):
            by_path = v.factor * (v.emitted + arriving)
            for light, value in ((v.light, v.direct), (v.on, by_path)):
                k = v.own & (value.max(1) > 0) & (light[:, 2] > 1e-4) & (v.eye[:, 2] > 1e-4)
                parts.append((reached[k] * value[k], light[k], v.eye[k], self.pixel[k]))
            arriving = v.direct + by_path
        if not parts:
            return np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, int)
        value, light, eye, pixel = (np.concatenate(p) for p in zip(*parts))
        return value, light, eye, pixel


def _trace(mi: Any, scene: Any, bsdf: str, width: int, height: int, spp: int, seed: int) -> _Paths:
    import drjit as dr

    count = width * height * spp
    sampler = mi.load_dict({"type": "independent", "sample_count": spp})
    sampler.seed(seed, count)
    number = dr.arange(mi.UInt32, count) // spp
    at = mi.Point2f(mi.Float(number % width), mi.Float(number // width)) + sampler.next_2d()
    at /= mi.Point2f(width, height)
    ray, _ = scene.sensors()[0].sample_ray(0.0, sampler.next_1d(), at, sampler.next_2d())
    context, target = mi.BSDFContext(), _pointer(mi, scene, bsdf)
    alive = dr.full(mi.Bool, True, count)
    si = scene.ray_intersect(ray)
    seen = _rgb(dr.select(alive, si.emitter(scene).eval(si), 0))
    vertices: list[_Vertex] = []
    for _ in range(DEPTH - 1):
        alive &= si.is_valid()
        if not dr.any(alive):
            break
        surface = si.bsdf(ray)
        own = alive & (surface == target)
        # light by a draw of a light
        light, drawn = scene.sample_emitter_direction(si, sampler.next_2d(), True, alive)
        toward = si.to_local(light.d)
        value, pdf = surface.eval_pdf(context, si, toward, alive)
        share = dr.select(light.delta, 1.0, _balance(dr, light.pdf, pdf))
        direct = dr.select(alive & (light.pdf > 0), value * drawn * share, 0)
        # the path goes on
        onward, factor = surface.sample(context, si, sampler.next_1d(), sampler.next_2d(), alive)
        ray = si.spawn_ray(si.to_world(onward.wo))
        following = scene.ray_intersect(ray, alive)
        emitter = following.emitter(scene, alive)
        smooth = mi.has_flag(onward.sampled_type, mi.BSDFFlags.Delta)
        found = scene.pdf_emitter_direction(si, mi.DirectionSample3f(scene, following, si), alive & ~smooth)
        share = dr.select(smooth, 1.0, _balance(dr, onward.pdf, found))
        emitted = dr.select(alive & (emitter != None), emitter.eval(following, alive) * share, 0)  # noqa: E711
        factor = dr.select(alive & (onward.pdf > 0), factor, 0)
        side = dr.sign(si.wi.z)  # twosided: the frame's other side
        flip = lambda v, side=side: _rows(mi.Vector3f(v.x, v.y, v.z * side))
        vertices.append(
            _Vertex(
                np.array(own), flip(si.wi), flip(toward), flip(onward.wo), _rgb(direct), _rgb(factor), _rgb(emitted)
            )
        )
        alive &= dr.max(factor) > 0
        si = following
    return _Paths(np.array(number), seen, vertices)


def _pointer(mi: Any, scene: Any, bsdf: str):
    for shape in scene.shapes():
        if shape.bsdf() is not None and shape.bsdf().id() == bsdf:
            return mi.BSDFPtr(shape.bsdf())
    raise ConfigError(f"no shape of the scene has the BSDF {bsdf!r}")


def _balance(dr: Any, a: Any, b: Any):
    return dr.select(a > 0, a / (a + b), 0)


def _rgb(colour: Any) -> Array:
    return np.nan_to_num(np.array(colour).T.astype(float).reshape(-1, 3), nan=0.0, posinf=0.0)


def _rows(v: Any) -> Array:
    rows = np.array(v).T.astype(float)
    return rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-12)


def _pixels(values: Array, pixel: Array, count: int, spp: int) -> Array:
    """Sums by pixel over spp, (count, 3)."""
    return np.stack([np.bincount(pixel, c, count) for c in values.T], 1) / spp
