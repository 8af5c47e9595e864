"""Ask/tell Metropolis-Hastings: the chain that decides where to look. Knows nothing of rigs, files or clocks."""

from gonio.mcmc.sampler import Batch, NoSupport, Sampler

__all__ = ["Batch", "NoSupport", "Sampler", "make_sampler"]


def make_sampler(material, reachable=None, fit_surrogate=None, cuts=()) -> Sampler:
    """The sampler that a `config.Material` describes; reachable, fit_surrogate and cuts as in `make_plan`."""
    from gonio.mcmc.plans import make_plan, make_target

    c, anisotropic = material.sampler, material.symmetry == "anisotropic"
    return Sampler(
        make_plan(c, anisotropic, fit_surrogate, material.seed, reachable, cuts),
        make_target(c, len(material.channels)),
        chains=c.chains,
        channels=len(material.channels),
        seed=material.seed,
        anisotropic=anisotropic,
        reachable=reachable,
    )
