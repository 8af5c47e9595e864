"""A spline coupling flow on the unit cube, in NumPy: density and draws. Training is `gonio.flow.train`'s.

Each coupling moves one coordinate by a warp of [0, 1] whose shape a residual network makes of the others (and of the
material's code). The base is the uniform density, so log q(x) is the sum of the warps' log slopes. Masks are fixed:
leading coordinates first, each given those before it, then the rest in turn, given all others; so one flow is both
p(all) and p(rest | leading). Networks are float32, splines and sums float64 (METHOD 8).
"""

from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np

from gonio.flow import encoding, lattice, one_point
from gonio.flow.coupling import Coupling
from gonio.flow.cubes import Cube
from gonio.flow.quadratic import Quadratic
from gonio.flow.rational import Rational
from gonio.geometry import Array

CHUNK = 256  # points whose activations the processor's cache holds
WARPS: dict[str, Any] = {"quadratic": Quadratic, "rational": Rational}


class FlowError(ValueError):
    """Weights or samples that no flow can be made of. One line."""

    exit_code = 2


@dataclass(frozen=True)
class Shape:
    """What a flow looks like. `leading` coordinates come first; `periodic` ones wrap; code = length of the context."""

    dimensions: int = 3
    leading: tuple[int, ...] = ()
    periodic: tuple[int, ...] = ()
    couplings: int = 4
    bins: int = 32
    hidden: int = 128
    blocks: int = 2
    warp: str = "quadratic"
    encoding: str = "plain"
    code: int = 0

    @classmethod
    def of(cls, cube: Cube, **more: Any) -> "Shape":
        """For the coordinates of a cube."""
        return cls(dimensions=cube.dimensions, leading=cube.leading, periodic=cube.periodic, **more)

    @cached_property
    def masks(self) -> tuple[tuple[int, tuple[int, ...]], ...]:
        """(moved, given) of each coupling."""
        lead = [(d, self.leading[:i]) for i, d in enumerate(self.leading)]
        rest = [d for d in range(self.dimensions) if d not in self.leading]
        turns = [rest[k % len(rest)] for k in range(self.couplings)]
        return (*lead, *((d, tuple(o for o in range(self.dimensions) if o != d)) for d in turns))

    def inputs(self, given: tuple[int, ...]) -> int:
        return encoding.width(self.encoding, tuple(d in self.periodic for d in given))

    def outputs(self, moved: int) -> int:
        """Numbers that a warp takes; a periodic one is shifted first, by one more."""
        return WARPS[self.warp].parameters(self.bins) + (moved in self.periodic)

    def sizes(self) -> dict[str, tuple[int, ...]]:
        """Names and shapes of all weights."""
        out: dict[str, tuple[int, ...]] = {}
        for k, (moved, given) in enumerate(self.masks):
            out[f"{k}.in.w"] = (self.inputs(given) + self.code, self.hidden)
            out[f"{k}.in.b"] = (self.hidden,)
            for layer in range(2 * self.blocks):
                out[f"{k}.{layer}.w"], out[f"{k}.{layer}.b"] = (self.hidden, self.hidden), (self.hidden,)
            out[f"{k}.out.w"], out[f"{k}.out.b"] = (self.hidden, self.outputs(moved)), (self.outputs(moved),)
        return out

    def to_arrays(self) -> dict[str, Array]:
        return {f"shape.{k}": np.array(v) for k, v in asdict(self).items()}

    @classmethod
    def from_arrays(cls, d: dict[str, Array]) -> "Shape":
        """Raises FlowError where a field is missing or of the wrong kind."""
        try:
            raw = {k: d[f"shape.{k}"] for k in cls.__dataclass_fields__}
            number = ("dimensions", "couplings", "bins", "hidden", "blocks", "code")
            return cls(
                **{k: int(raw[k]) for k in number},
                leading=tuple(int(v) for v in raw["leading"]),
                periodic=tuple(int(v) for v in raw["periodic"]),
                warp=str(raw["warp"]),
                encoding=str(raw["encoding"]),
            )
        except (KeyError, TypeError, ValueError) as e:
            raise FlowError(f"not a flow's shape ({e}); made by another version?") from None


class Flow:
    """Shape and weights. `code` (shape.code,) is the material; a flow with a code of length 0 has none."""

    def __init__(self, shape: Shape, weights: dict[str, Array], code: Array | None = None):
        wanted = shape.sizes()
        wrong = [k for k, size in wanted.items() if k not in weights or np.shape(weights[k]) != size]
        if wrong or shape.warp not in WARPS:
            raise FlowError(f"weights do not fit the flow's shape (first: {(wrong or [shape.warp])[0]})")
        if not all(np.isfinite(weights[k]).all() for k in wanted):
            raise FlowError("weights are not all finite; train anew")
        self.shape = shape
        self.weights = {k: np.ascontiguousarray(weights[k], np.float32) for k in wanted}
        self.code = np.zeros(shape.code) if code is None else np.asarray(code, float)
        self._warp = WARPS[shape.warp]
        self._couplings = [self._coupling(k, moved, given) for k, (moved, given) in enumerate(shape.masks)]

    @classmethod
    def fresh(cls, shape: Shape, rng: np.random.Generator) -> "Flow":
        """The identity: last layers are zero, so that untrained it is the uniform density."""
        weights = {}
        for name, size in shape.sizes().items():
            if name.endswith(".b") or ".out." in name:
                weights[name] = np.zeros(size, np.float32)
            else:
                weights[name] = (rng.standard_normal(size) * np.sqrt(2 / max(size[0], 1))).astype(np.float32)
        return cls(shape, weights)

    def at(self, code: Array) -> "Flow":
        """The same flow for another material."""
        return Flow(self.shape, self.weights, code)

    def log_prob(self, x: Array) -> Array:
        """log density (N,) at x (N, D) in the cube."""
        if len(x) == 1 and self.shape.warp == "quadratic" and not self.shape.periodic:
            return np.array([one_point.log_prob(self._couplings, self.shape, x[0])])
        return self.to_base(x)[1]

    def to_base(self, x: Array) -> tuple[Array, Array]:
        """z (N, D), uniform if x follows the flow, and log |dz/dx| = log density at x."""
        y = _inside(x)
        return y, self._forward(self._couplings, y)

    def from_base(self, z: Array) -> tuple[Array, Array]:
        """x (N, D) and log density there: the inverse of `to_base`, so uniform z give draws."""
        y = _inside(z)
        return y, self._backward(self._couplings, y)

    def conditional(self, x: Array) -> Array:
        """log p(rest | leading), (N,), at x (N, D)."""
        y, lead = _inside(x), len(self.shape.leading)
        self._forward(self._couplings[:lead], y)
        return self._forward(self._couplings[lead:], y)

    def conditional_draw(self, x: Array) -> tuple[Array, Array]:
        """x (N, D), its leading coordinates as they are, the rest drawn by the uniform numbers they hold; and
        log p(rest | leading)."""
        y, lead = _inside(x), len(self.shape.leading)
        given = y[:, list(self.shape.leading)]
        self._forward(self._couplings[:lead], y)  # the rest hang on where the leading ones go
        log_q = self._backward(self._couplings[lead:], y)
        y[:, list(self.shape.leading)] = given
        return y, log_q

    def _forward(self, couplings: list[Coupling], y: Array) -> Array:
        """Moves y (N, D) towards the base in place; log |slope| (N,)."""
        log_q = np.zeros(len(y))
        for part in _chunks(len(y)):
            for c in couplings:
                warp, shift = self._shape_of(c, y[part])
                here = y[part, c.moved]
                y[part, c.moved], slope = warp.forward(here if shift is None else (here + shift) % 1.0)
                log_q[part] += slope
        return log_q

    def _backward(self, couplings: list[Coupling], y: Array) -> Array:
        """Moves y (N, D) away from the base in place; log |slope| (N,) of the way towards it."""
        log_q = np.zeros(len(y))
        for part in _chunks(len(y)):
            for c in reversed(couplings):
                warp, shift = self._shape_of(c, y[part])
                here, slope = warp.inverse(y[part, c.moved])
                y[part, c.moved] = here if shift is None else (here - shift) % 1.0
                log_q[part] += slope
        return log_q

    def to_arrays(self) -> dict[str, Array]:
        return self.shape.to_arrays() | {"code": self.code} | {f"weight.{k}": v for k, v in self.weights.items()}

    @classmethod
    def from_arrays(cls, d: dict[str, Array]) -> "Flow":
        """Raises FlowError."""
        shape = Shape.from_arrays(d)
        return cls(shape, {k[7:]: v for k, v in d.items() if k.startswith("weight.")}, d.get("code"))

    def _coupling(self, k: int, moved: int, given: tuple[int, ...]) -> Coupling:
        w, inputs = self.weights, self.shape.inputs(given)
        # the code is the same for every point: its part of the first layer is a bias
        bias = w[f"{k}.in.b"] + self.code.astype(np.float32) @ w[f"{k}.in.w"][inputs:]
        layers = [np.vstack([w[f"{k}.{i}.w"], w[f"{k}.{i}.b"]]) for i in range(2 * self.shape.blocks)]
        first, last = np.vstack([w[f"{k}.in.w"][:inputs], bias]), np.vstack([w[f"{k}.out.w"], w[f"{k}.out.b"]])
        c = Coupling(moved, list(given), tuple(d in self.shape.periodic for d in given), first, layers, last)
        if not given:
            c.constant = self._warped(c, c.network(np.ones((1, 1), np.float32)))
        return c

    def _shape_of(self, c: Coupling, y: Array):
        if c.constant is not None:
            return c.constant
        return self._warped(c, lattice.numbers(c, self.shape.encoding, y[:, c.given]))

    def _warped(self, c: Coupling, raw: Array):
        tied = c.moved in self.shape.periodic
        shift = raw[-1].astype(float) if tied else None
        return self._warp(raw[:-1] if tied else raw, self.shape.bins, tied), shift


def _inside(x: Array) -> Array:
    """A copy within the cube's faces: rounding may have put a point a hair beyond them."""
    return np.minimum(np.maximum(x, 0.0), 1.0)


def _chunks(n: int) -> list[slice]:
    return [slice(k, k + CHUNK) for k in range(0, n, CHUNK)]
