"""gonio: a Markov chain decides where to look, a rig looks there, and what it saw becomes a BRDF.

For notebooks and scripts (each is documented where it is made, and typed in `__init__.pyi`):

    gonio.Material(...)                      a sample and the run to make of it
    gonio.open_rig(name, truth=f)            a rig; f(wi, wo) is what a simulated one shows
    gonio.acquire(material, rig, callback=…) a run -> Run;  gonio.resume(run), gonio.open_run(path)
    gonio.make_sampler(material, rig)        the chain alone: ask, tell
    gonio.load_brdf(path)                    any BRDF: eval, sample, pdf, plot
    gonio.Samples.of(wi, wo, f)              readings of one's own, for gonio.reconstruct.reconstruct(samples, model)
    gonio.from_angles(theta, phi)            unit vectors, from radians
"""

import sys
from importlib import import_module
from types import ModuleType

__version__ = "0.1.0"

_MADE_BY = {
    "Material": "gonio.api.material",
    "OpenRig": "gonio.api.rig",
    "open_rig": "gonio.api.rig",
    "Run": "gonio.api.run",
    "open_run": "gonio.api.run",
    "acquire": "gonio.api.measuring",
    "resume": "gonio.api.measuring",
    "make_sampler": "gonio.api.measuring",
    "Samples": "gonio.reconstruct.samples",
    "from_angles": "gonio.geometry",
}
__all__ = [*sorted(_MADE_BY), "load_brdf"]


def load_brdf(path):
    """Open a run folder, a saved reconstruction (.npz), an RGL .bsdf or a MERL .binary as a `Brdf`.

    path may also be the name of a material, see `gonio.brdf.library`. Raises `gonio.brdf.BrdfFileError`.

    Examples:
        >>> import gonio
        >>> gloss = gonio.load_brdf("analytic_gloss")
        >>> up = gonio.from_angles([0.0], [0.0])
        >>> gloss.eval(up, up).shape
        (1, 3)
    """
    plotted = import_module("gonio.api.plot").plotted
    return plotted(import_module("gonio.load").load_brdf(path))


class _Package(ModuleType):
    """`gonio.acquire` is the function, also once the module of that name, the loop, has been imported."""

    def __setattr__(self, name: str, value: object) -> None:
        if not (name == "acquire" and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


def __getattr__(name: str):
    if name not in _MADE_BY:
        raise AttributeError(f"module 'gonio' has no attribute {name!r}")
    return getattr(import_module(_MADE_BY[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


sys.modules[__name__].__class__ = _Package
