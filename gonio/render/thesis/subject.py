"""What the thesis's figures are about: one run, what was made of it, and what there is to compare it with."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

from gonio.brdf import Brdf
from gonio.brdf.tables.slices import SlicesBrdf
from gonio.geometry import Array
from gonio.reconstruct import Samples, reconstruct
from gonio.render.shade import render_sphere


class Missing(ValueError):
    """A figure cannot be made of this run: what it needs and how to get it, one line."""

    exit_code = 2


class Density(Protocol):
    """Of pairs of directions: a flow's."""

    def log_prob(self, wi: Array, wo: Array) -> Array: ...


@dataclass(frozen=True)
class Subject:
    """A run. `flow` is its reconstruction by a flow, `density` that flow's density; both may be absent.

    size, spp: of the rendered spheres.
    """

    name: str
    proposal: str
    channels: tuple[str, ...]
    samples: Samples
    ours: Brdf
    truth: Brdf | None = None
    density: Density | None = None
    flow: Brdf | None = None
    size: int = 160
    spp: int = 24
    seed: int = 0

    @cached_property
    def thesis(self) -> SlicesBrdf:
        """The thesis's reconstruction of the same samples. Raises ReconstructionError."""
        brdf = reconstruct(self.samples, "thesis", seed=self.seed)
        assert isinstance(brdf, SlicesBrdf)
        return brdf

    @property
    def known(self) -> Brdf:
        """The truth. Raises Missing."""
        if self.truth is None:
            raise Missing("needs the truth, which nobody knows of a real sample; name a BRDF by --truth")
        return self.truth

    def need_colours(self) -> None:
        """Raises Missing where the first three channels cannot be shown as red, green and blue."""
        if self.ours.channels < 3:
            raise Missing(f"needs three channels, the run has {self.ours.channels}")

    @cached_property
    def truth_image(self) -> Array:
        return self.image(self.known)

    @cached_property
    def thesis_image(self) -> Array:
        return self.image(self.thesis)

    @cached_property
    def our_image(self) -> Array:
        return self.image(self.ours)

    @cached_property
    def flow_image(self) -> Array:
        """Raises Missing."""
        return self.image(self.by_flow)

    @property
    def by_flow(self) -> Brdf:
        """The reconstruction by a flow. Raises Missing."""
        if self.flow is None:
            raise Missing("needs a flow; make it with `gonio reconstruct RUN --model flow --out RUN/flow.npz`")
        return self.flow

    def image(self, brdf: Brdf) -> Array:
        """A shaded sphere, linear RGB; the truth draws the directions where there is one, the same for all."""
        return render_sphere(brdf, self.size, self.spp, sampler=self.truth)
