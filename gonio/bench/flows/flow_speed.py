"""The flow's arithmetic: its errors where it is as peaked as chrome, and its speed beside normflows' in one run.

Round trip and log-det are of the conditional flow at the code nearest to `peaked`, on points of the whole cube, its
faces included. Speed is of the thesis's architecture (4 couplings, 2 blocks of 2 x 128, 32 bins, 3 dimensions), one
thread, medians of interleaved runs.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np

from gonio.bench.drive import truth_of
from gonio.bench.flows.pretrain import target_of
from gonio.config.loader import Section
from gonio.flow import shipped
from gonio.flow.cubes import make_cube
from gonio.flow.flow import Flow, Shape
from gonio.flow.pool import resampled, weighted
from gonio.geometry import Array


class Config(Section):
    study: Literal["flow_speed"]
    peaked: str = "chm_orange"
    points: int = 1_000_000
    repeats: int = 15


def run(config: Config, out: Path, say: Callable[[str], None]) -> None:
    rng = np.random.default_rng(1)
    flow = peaked_flow(config.peaked, rng)
    x = rng.random((config.points, 3))
    face = rng.random(x.shape) < 0.02
    x[face] = np.round(x[face])  # some on faces, edges and corners
    z, log_q = flow.to_base(x)
    back, log_back = flow.from_base(z)
    outside = int(((z < 0) | (z > 1) | (back < 0) | (back > 1)).any(1).sum())
    say(f"log density of the flow at the code of {config.peaked}: {log_q.min():.1f} to {log_q.max():.1f}")
    say(f"round trip, {config.points} points: {np.abs(back - x).max():.1e}")
    say(f"log-det, forward against inverse: {np.abs(log_back - log_q).max():.1e}; points outside the cube: {outside}")
    say("")
    say(f"{'1 thread':26}{'ours ms':>10}{'normflows ms':>14}{'ratio':>8}")
    shape = Shape()
    ours, theirs = Flow.fresh(shape, rng), normflows(shape)
    for batch in (1, 64, 4096):
        points = rng.random((batch, 3))
        a, b = interleaved(lambda p=points: ours.log_prob(p), theirs.log_prob_of(points), config.repeats, batch)
        say(f"{f'log q, batch {batch}':26}{1e3 * a:10.3f}{1e3 * b:14.3f}{b / a:8.1f}")
    points = rng.beta(2, 5, (4096, 3))
    a, b = interleaved(step_of_ours(ours, points), theirs.step_of(points), config.repeats, 512)
    say(f"{'train step of 512':26}{1e3 * a:10.3f}{1e3 * b:14.3f}{b / a:8.1f}")


def peaked_flow(material: str, rng: np.random.Generator) -> Flow:
    flow, codes = shipped.conditional()
    cube = make_cube("half", 0.1)
    x, log_w = weighted(cube, target_of(truth_of(material), rng), 40_000, rng)
    x = resampled(x, log_w, 1000, rng)
    return flow.at(codes.fit(flow, x, np.ones(len(x))))


def interleaved(a: Callable, b: Callable, repeats: int, batch: int) -> tuple[float, float]:
    """Median seconds of each, taken in turns; a small batch is repeated within a turn."""
    inner = 50 if batch == 1 else 5 if batch == 64 else 1
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(repeats):
        for call, mine in zip((a, b), times):
            began = time.perf_counter()
            for _ in range(inner):
                call()
            mine.append((time.perf_counter() - began) / inner)
    return float(np.median(times[0])), float(np.median(times[1]))


def step_of_ours(flow: Flow, x: Array) -> Callable[[], float | None]:
    from gonio.flow.train import Stepper

    return Stepper(flow, x, np.ones(len(x)), steps=10_000, batch=512, rate=1e-3, rng=np.random.default_rng(1)).step


class normflows:
    """The same architecture there: rational-quadratic couplings, the only spline it has."""

    def __init__(self, shape: Shape):
        import normflows as nf

        from gonio.flow.train import torch

        torch.set_num_threads(1)
        torch.manual_seed(0)
        flows = []
        for _ in range(shape.couplings):
            flows += [
                nf.flows.CoupledRationalQuadraticSpline(
                    shape.dimensions, shape.blocks, shape.hidden, num_bins=shape.bins, tail_bound=1.0
                ),
                nf.flows.LULinearPermute(shape.dimensions),
            ]
        self.torch = torch
        self.model = nf.NormalizingFlow(nf.distributions.DiagGaussian(shape.dimensions, trainable=False), flows)

    def log_prob_of(self, x: Array) -> Callable[[], None]:
        points = self.torch.tensor(x, dtype=self.torch.float32)

        def call() -> None:
            with self.torch.no_grad():
                self.model.log_prob(points)

        return call

    def step_of(self, x: Array, batch: int = 512) -> Callable[[], None]:
        torch = self.torch
        points = torch.tensor(x, dtype=torch.float32)
        optimiser = torch.optim.AdamW(self.model.parameters(), lr=1e-3, fused=True)
        rng = np.random.default_rng(1)

        def step() -> None:
            i = torch.tensor(rng.integers(len(x), size=batch))
            optimiser.zero_grad()
            loss = self.model.forward_kld(points[i])
            loss.backward()
            torch.nn.utils.clip_grad_norm_(self.model.parameters(), 5.0)
            optimiser.step()

        return step
