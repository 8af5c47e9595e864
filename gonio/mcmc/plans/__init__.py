"""Plans: which proposals a run cycles through, in blocks of how many steps, and what they learn on the way.

A plan offers `kernels` [(proposal, block)], `learns`, `learn(target, wi, wo, f, log_q)` on all but the chains' present
points, `screen` (a surrogate's eval for delayed acceptance, or None), `state()` and `restore()`; one that wants to know
where chains go besides offers `follow(accepted, wi, wo)`. A cycle of kernels each of which leaves the target alone
leaves it alone. One that designs its blocks as a whole offers `pilot()` and `design(...)` instead (`UnknownPlan`).
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from gonio.config.material import SamplerConfig
from gonio.config.material import Target as TargetConfig
from gonio.geometry import Array
from gonio.mcmc.proposals.independence import Independence, single_lobe
from gonio.mcmc.proposals.pss_simple import PssSimple
from gonio.mcmc.proposals.pss_vndf import PssVndf
from gonio.mcmc.proposals.vmf import VmfHd, VmfIo
from gonio.mcmc.target import Target, Unknown


class Fixed:
    """One proposal throughout; nothing learnt."""

    learns = False
    screen: Callable[[Array, Array], Array] | None = None

    def __init__(self, proposal, block: int = 1):
        self.kernels = [(proposal, block)]

    def learn(self, target: Target, wi: Array, wo: Array, f: Array, log_q: Array) -> None:
        """Nothing."""

    def state(self) -> dict[str, Any]:
        return {}

    def restore(self, state: dict[str, Any], target: Target) -> None:
        """Nothing to restore."""


def plain_proposal(name: str, c: SamplerConfig, anisotropic: bool):
    """The proposal of that name with the config's numbers."""
    cube: dict[str, Any] = {
        "anisotropic": anisotropic,
        "sigma": c.sigma,
        "global_share": c.global_share,
        "boundary": c.boundary,
    }
    alpha_y = c.alpha if c.alpha_y is None else c.alpha_y
    if name == "pss_simple":
        return PssSimple(**cube)
    if name == "pss_vndf":
        return PssVndf(c.alpha, alpha_y, **cube)
    if name == "vmf_io":
        return VmfIo(kappa=c.kappa, global_share=c.global_share)
    if name == "vmf_hd":
        return VmfHd(kappa=c.kappa, global_share=c.global_share)
    if name == "independence":
        return Independence(single_lobe(c.alpha, alpha_y))
    raise KeyError(name)


def make_plan(
    c: SamplerConfig,
    anisotropic: bool,
    fit_surrogate: Callable | None = None,
    seed: int = 0,
    reachable: Callable | None = None,
    cuts: tuple[int, ...] = (),
):
    """The plan a config names. fit_surrogate(wi, wo, f[, sigma]) -> Brdf is the running reconstruction; reachable and
    cuts as in `UnknownPlan`."""
    if c.target.kind == "unknown":
        from gonio.mcmc.plans.unknown import UnknownPlan

        return UnknownPlan(
            fit_surrogate,
            anisotropic=anisotropic,
            reachable=reachable,
            cuts=cuts,
            adapt=bool(c.adapt),
            asked=_asked(c.target),
        )
    if c.proposal == "auto":
        from gonio.mcmc.plans.auto import Auto

        return Auto(block=c.block, anisotropic=anisotropic, adapt=bool(c.adapt), fit_surrogate=fit_surrogate)
    if c.proposal == "flow" and c.adapt == "thesis":
        from gonio.mcmc.plans.thesis import ThesisFlow

        return ThesisFlow(c, seed)
    if c.proposal == "flow":
        from gonio.mcmc.plans.flow import FlowPlan

        return FlowPlan(
            c.flow, seed, block=c.block, anisotropic=anisotropic, adapt=bool(c.adapt), fit_surrogate=fit_surrogate
        )
    if c.proposal == "delayed":
        from gonio.mcmc.plans.delayed import Delayed

        return Delayed(plain_proposal(c.inner, c, anisotropic), fit_surrogate)
    return Fixed(plain_proposal(c.proposal, c, anisotropic), c.block if c.proposal == "independence" else 1)


def _asked(target: TargetConfig) -> Callable[[Array, Array], Array] | None:
    """log (w + floor) of the picture that a target names. Raises PictureError."""
    if target.scene is None:
        return None
    from gonio import picture

    w = picture.load(target.scene)
    return lambda wi, wo: np.log((w(wi, wo) + target.scene_floor) / (1 + target.scene_floor))


def make_target(c: SamplerConfig, channels: int) -> Target:
    assert c.target.channels is not None and c.target.power is not None
    kind = Unknown if c.target.kind == "unknown" else Target
    return kind(c.target.channels, c.target.power, c.target.floor, channels)
