"""A sampler against a BRDF, with nothing between: what the studies of chains measure."""

from dataclasses import dataclass
from functools import partial

import numpy as np

import gonio
from gonio.brdf import Brdf
from gonio.config import Material
from gonio.geometry import Array
from gonio.mcmc import Sampler, make_sampler
from gonio.mcmc.chain.steps import Steps


@dataclass(frozen=True)
class Driven:
    """What a run was: its step log, and wi, wo, f by measurement; of how many measurements the log speaks."""

    steps: Steps
    wi: Array
    wo: Array
    f: Array
    measurements: int

    def chains(self, values: Array, burn_in: float = 0.0) -> Array:
        """values (M, …) by measurement -> (chains, steps, …) by the state each chain is at, after the burn-in share."""
        s = self.steps
        keep = s.step >= 0
        count = int(s.chain.max()) + 1
        state = s.state[keep].reshape(-1, count).T  # columns are logged all chains at once
        begin = int(max((state < 0).sum(1).max(), burn_in * state.shape[1]))
        return values[state[:, begin:]]

    def log_p(self, burn_in: float = 0.0) -> Array:
        """log of the target at each state, (chains, steps)."""
        s = self.steps
        keep = s.step >= 0
        count = int(s.chain.max()) + 1
        state, log_p = (a[keep].reshape(-1, count).T for a in (s.state, s.log_p))
        begin = int(max((state < 0).sum(1).max(), burn_in * state.shape[1]))
        return log_p[:, begin:]


def truth_of(spec: str) -> Brdf:
    """A material by name or path, or `ggx:ALPHA` for an analytic one: 20 % Lambert under a GGX lobe of F0 0.5."""
    if spec.startswith("ggx:"):
        from gonio.brdf.models.lambert import Lambert
        from gonio.brdf.models.microfacet import Ggx
        from gonio.brdf.models.mixture import Mixture

        return Mixture([Lambert([0.2] * 3), Ggx(float(spec[4:]), None, [0.5] * 3)])
    from gonio.brdf.library import find

    return gonio.load_brdf(find(spec).path)


def drive(brdf: Brdf, sampler: dict | str, measurements: int, **how) -> Driven:
    """As `driven_by`, whose keywords it takes, without the sampler."""
    return driven_by(brdf, sampler, measurements, **how)[0]


def driven_by(
    brdf: Brdf,
    sampler: dict | str,
    measurements: int,
    *,
    chains: int = 1,
    seed: int = 1,
    steps: int | None = None,
    symmetry: str = "isotropic",
) -> tuple[Driven, Sampler]:
    """Run a sampler section against `brdf` until so many measurements (or steps) are made; and the sampler, as left."""
    section = sampler if isinstance(sampler, str) else {**sampler, "chains": chains}
    material = Material.model_validate(
        {"name": "study", "channels": brdf.channels, "seed": seed, "symmetry": symmetry, "sampler": section}
    )
    if isinstance(sampler, str):
        material = material.model_copy(update={"sampler": material.sampler.model_copy(update={"chains": chains})})
    anisotropic = symmetry == "anisotropic"
    chain = make_sampler(material, None, partial(surrogate, anisotropic=anisotropic), (measurements,))
    wi, wo, f, made = [], [], [], 0
    while made < measurements and (steps is None or chain.step < steps):
        batch = chain.ask()
        wi.append(batch.wi)
        wo.append(batch.wo)
        f.append(brdf.eval(batch.wi, batch.wo))
        made += len(batch.ids)
        chain.tell(batch.ids, f[-1])
    values = np.concatenate(f)
    return Driven(chain.take_steps(), np.concatenate(wi), np.concatenate(wo), values, len(values)), chain


def surrogate(wi: Array, wo: Array, f: Array, sigma: Array | None = None, *, anisotropic: bool = False) -> Brdf:
    """What plans learn from and `delayed` acceptance screens with: the running reconstruction."""
    from gonio.reconstruct.running import fit
    from gonio.reconstruct.samples import Samples

    return fit(Samples.of(wi, wo, f, sigma), anisotropic=anisotropic)
