"""Training of flows: weighted forward KL by AdamW. The only module that imports torch (2.4 s, 500 MB).

Networks in float32, splines in float64, one thread; batches come from a NumPy generator, so that a seed gives the same
weights to the bit. A step whose loss or gradient is not finite is left out.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from gonio.flow import encoding
from gonio.flow.flow import Flow, FlowError, Shape
from gonio.flow.quadratic import SMALLEST, Quadratic
from gonio.geometry import Array

CLIP = 5.0  # of the gradient's norm
WEIGHT_DECAY = 1e-4
HUBER = 0.2  # relative error beyond which the loss of `match` grows linearly
LOOK = 50  # steps between two looks at the points held back
CODE_PRIOR = 1e-3  # codes are held to a unit normal by this much of its -log density


@dataclass(frozen=True)
class Trained:
    """The flow, the codes (M, code) of the materials it was trained on, the mean loss of each tenth, steps left out."""

    flow: Flow
    codes: Array
    losses: Array
    skipped: int


def train(
    flow: Flow,
    x: Array,
    weight: Array | None = None,
    *,
    material: Array | None = None,
    codes: Array | None = None,
    steps: int,
    batch: int = 512,
    rate: float = 1e-3,
    rng: np.random.Generator,
) -> Trained:
    """Minimise -E[log q(x)] over points x (N, D) with weights (N,) >= 0, from the weights that `flow` has.

    material (N,) says whose code each point has; codes (M, code) are where they start and are trained too (without
    them the flow's own code is kept). The rate falls to 0 by a cosine. Raises FlowError.
    """
    stepper = Stepper(flow, x, weight, material=material, codes=codes, steps=steps, batch=batch, rate=rate, rng=rng)
    losses = [loss for loss in (stepper.step() for _ in range(steps)) if loss is not None]
    if not losses:
        raise FlowError("no training step had a finite loss; the samples are of no use to a flow")
    tenths = np.array([np.mean(part) for part in np.array_split(losses, min(10, len(losses)))])
    return Trained(stepper.flow(), stepper.codes(), tenths, steps - len(losses))


class Stepper:
    """The state of a training: `step()` is the loss of one batch, None if it was left out; arguments as `train`'s."""

    def __init__(
        self, flow: Flow, x: Array, weight: Array | None, *, material: Array | None = None,
        codes: Array | None = None, steps: int, batch: int, rate: float, rng: np.random.Generator,
    ):  # fmt: skip
        x, weight = _usable(x, weight)
        torch.set_num_threads(1)
        self.start, self.batch, self.rng, self.material = flow, batch, rng, material
        self.weights = {k: torch.tensor(v, requires_grad=True) for k, v in flow.weights.items()}
        groups: list[dict[str, Any]] = [{"params": list(self.weights.values())}]
        self.table = None
        if codes is not None:
            self.table = torch.tensor(np.asarray(codes, np.float32), requires_grad=True)
            groups.append({"params": [self.table], "weight_decay": 0.0})
        self.own = torch.tensor(flow.code, dtype=torch.float32)
        self.optimiser = torch.optim.AdamW(groups, lr=rate, weight_decay=WEIGHT_DECAY, fused=True)
        self.schedule = torch.optim.lr_scheduler.CosineAnnealingLR(self.optimiser, steps)
        self.parameters = [q for g in groups for q in g["params"]]
        self.points = torch.tensor(x)
        self.cumulative = np.cumsum(weight / weight.sum())

    def step(self) -> float | None:
        i = np.minimum(np.searchsorted(self.cumulative, self.rng.random(self.batch)), len(self.points) - 1)
        table = self.table
        code = self.own.expand(self.batch, -1) if table is None else table[torch.tensor(np.asarray(self.material)[i])]
        loss = -log_prob(self.weights, self.start.shape, self.points[torch.tensor(i)], code).mean()
        if table is not None:
            loss = loss + CODE_PRIOR * 0.5 * (table * table).sum(1).mean()
        self.optimiser.zero_grad()
        loss.backward()
        norm = torch.nn.utils.clip_grad_norm_(self.parameters, CLIP, foreach=True)
        value = loss.item()
        usable = bool(np.isfinite(value)) and bool(torch.isfinite(norm))
        if usable:
            self.optimiser.step()
        self.schedule.step()
        return value if usable else None

    def flow(self) -> Flow:
        """With the weights as they are now."""
        return Flow(self.start.shape, {k: q.detach().numpy().copy() for k, q in self.weights.items()}, self.start.code)

    def codes(self) -> Array:
        """(M, code) as they are now."""
        if self.table is None:
            return np.zeros((0, self.start.shape.code))
        return self.table.detach().numpy().astype(float)


def match(
    flow: Flow,
    x: Array,
    log_g: Array,
    held: Array,
    *,
    steps: int,
    batch: int = 512,
    rate: float = 1e-3,
    rng: np.random.Generator,
) -> tuple[Flow, float]:
    """The flow and log c for which c q(x) is g = exp(log_g), (N,), in mean relative error (thesis 4.11).

    The error is taken as |log(c q / g)|, which is the relative one where it is small: as written (4.11) is at most 1
    for a flow that is too dark, and such a flow stays so. Beyond a fifth it counts linearly. c is the closed-form
    optimum of the relative error for fixed weights, sum(q/g) / sum((q/g)^2) as (4.15) is of the absolute one, taken
    anew at the best state so far only, as the points `held` (N,) bool, not trained on, judge it. In the first quarter,
    when no state is worth a constant, each batch has its own: held to a wrong one the flow starves a tenth of the
    points to raise the others. Raises FlowError.
    """
    x, good = _usable(x, np.isfinite(log_g).astype(float))
    torch.set_num_threads(1)
    p = {k: torch.tensor(v, requires_grad=True) for k, v in flow.weights.items()}
    code = torch.tensor(flow.code, dtype=torch.float32)
    optimiser = torch.optim.AdamW(list(p.values()), lr=rate, weight_decay=WEIGHT_DECAY, fused=True)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    learn, judge = np.flatnonzero(~held & (good > 0)), np.flatnonzero(held & (good > 0))
    points, goal = torch.tensor(x), torch.tensor(log_g)

    def constant(q: Flow) -> tuple[float, float]:
        """log c and the loss of the points held back."""
        apart = q.log_prob(x[learn]) - log_g[learn]
        r = np.exp(np.clip(apart - np.median(apart), -1.0, 1.0))
        log_c = float(np.log(r.sum() / (r * r).sum()) - np.median(apart))
        error = np.abs(q.log_prob(x[judge]) + log_c - log_g[judge])
        return log_c, float(error.mean())

    log_c, loss = constant(flow)
    best = (loss, flow, log_c)
    for step in range(steps):
        i = torch.tensor(learn[rng.integers(len(learn), size=batch)])
        log_q = log_prob(p, flow.shape, points[i], code.expand(batch, -1))
        constant_now = log_c if step >= steps // 4 else (goal[i] - log_q).detach().median()
        objective = torch.nn.functional.huber_loss(log_q + constant_now, goal[i], delta=HUBER)
        optimiser.zero_grad()
        objective.backward()
        norm = torch.nn.utils.clip_grad_norm_(list(p.values()), CLIP, foreach=True)
        if bool(torch.isfinite(norm)):
            optimiser.step()
        schedule.step()
        if step % LOOK == LOOK - 1 or step == steps // 4 - 1:
            now = Flow(flow.shape, {k: q.detach().numpy().copy() for k, q in p.items()}, flow.code)
            new_c, loss = constant(now)
            if loss < best[0]:
                best, log_c = (loss, now, new_c), new_c
    return best[1], best[2]


def log_prob(p: dict[str, torch.Tensor], shape: Shape, x: torch.Tensor, code: torch.Tensor) -> torch.Tensor:
    """log density (N,) at x (N, D): `Flow.log_prob` with gradients."""
    columns = list(x.unbind(1))
    total = torch.zeros(len(x), dtype=torch.float64)
    centres = torch.tensor(encoding.CENTRES)
    for k, (moved, given) in enumerate(shape.masks):
        periodic = tuple(d in shape.periodic for d in given)
        if given:
            y = torch.stack([columns[d] for d in given], 1)
            shown = [c.float() for c in encoding.columns(shape.encoding, y, periodic, torch, centres)]
        else:
            shown = []
        h = torch.addmm(p[f"{k}.in.b"], torch.cat([*shown, code], 1), p[f"{k}.in.w"])
        for layer in range(0, 2 * shape.blocks, 2):
            r = torch.addmm(p[f"{k}.{layer}.b"], torch.relu(h), p[f"{k}.{layer}.w"])
            h = h + torch.addmm(p[f"{k}.{layer + 1}.b"], torch.relu(r), p[f"{k}.{layer + 1}.w"])
        raw = torch.addmm(p[f"{k}.out.b"], torch.relu(h), p[f"{k}.out.w"])
        here, tied = columns[moved], moved in shape.periodic
        if tied:
            here, raw = (here + raw[:, -1].double()) % 1.0, raw[:, :-1]
        columns[moved], slope = WARPS[shape.warp](here, raw, shape.bins, tied)
        total = total + slope
    return total


class _Quadratic(torch.autograd.Function):
    """`gonio.flow.quadratic` at x (N,): z and log dz/dx, with the gradients it gives itself."""

    @staticmethod
    def forward(ctx: Any, x: torch.Tensor, raw: torch.Tensor, bins: int, tied: bool) -> tuple[torch.Tensor, ...]:
        ctx.x, ctx.warp = x.numpy(), Quadratic(np.ascontiguousarray(raw.numpy().T), bins, tied)
        return tuple(torch.from_numpy(a) for a in ctx.warp.forward(ctx.x))

    @staticmethod
    def backward(ctx: Any, *by: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        by_x, by_raw = ctx.warp.gradient(ctx.x, by[0].numpy(), by[1].numpy())
        return torch.from_numpy(by_x), torch.from_numpy(by_raw.T.astype(np.float32, order="C")), None, None


def rational(x: torch.Tensor, raw: torch.Tensor, bins: int, tied: bool) -> tuple[torch.Tensor, torch.Tensor]:
    """`gonio.flow.rational` at x (N,): z and log dz/dx."""
    raw = raw.double()
    w = SMALLEST + (1 - bins * SMALLEST) * torch.softmax(raw[:, :bins], 1)
    h = SMALLEST + (1 - bins * SMALLEST) * torch.softmax(raw[:, bins : 2 * bins], 1)
    d = SMALLEST + torch.nn.functional.softplus(raw[:, 2 * bins :])
    if tied:
        d = torch.cat([d[:, :-1], d[:, :1]], 1)
    edges, heights = torch.cumsum(w, 1), torch.cumsum(h, 1)
    k = (edges[:, :-1] <= x[:, None]).sum(1, keepdim=True)
    wk, hk, d0, d1 = (a.gather(1, i).squeeze(1) for a, i in ((w, k), (h, k), (d, k), (d, k + 1)))
    left_x, left_z = edges.gather(1, k).squeeze(1) - wk, heights.gather(1, k).squeeze(1) - hk
    t, s = ((x - left_x) / wk).clamp(0, 1), hk / wk
    u = 1 - t
    down = s + (d0 + d1 - 2 * s) * t * u
    z = left_z + hk * t * (s * t + d0 * u) / down
    up = s * s * (d1 * t * t + 2 * s * t * u + d0 * u * u)
    return z.clamp(0, 1), torch.log(up) - 2 * torch.log(down)


WARPS = {"quadratic": _Quadratic.apply, "rational": rational}


def _usable(x: Array, weight: Array | None) -> tuple[Array, Array]:
    """Points with a finite positive weight. Raises FlowError where fewer than 10 are left, or all are one point."""
    x = np.asarray(x, float)
    weight = np.ones(len(x)) if weight is None else np.asarray(weight, float)
    if not np.isfinite(weight).all() or (weight < 0).any():
        raise FlowError(f"{int((~np.isfinite(weight) | (weight < 0)).sum())} sample weights are not numbers >= 0")
    x = np.where((weight > 0)[:, None], x, np.nan)
    good = np.asarray(np.isfinite(x).all(1))
    if good.sum() < 10:
        raise FlowError(f"{int(good.sum())} samples of weight > 0; a flow needs 10 at least")
    if np.ptp(x[good], axis=0).max() < 1e-9:
        raise FlowError("all samples lie on one spot; a flow cannot be made of them")
    # dropping points would spoil the caller's indices: they get weight 0 instead
    return np.where(good[:, None], x, 0.5), np.where(good, weight, 0.0)
