"""gonio: a Markov chain decides where to look, a rig looks there, and what it saw becomes a BRDF."""

__version__ = "0.1.0"


def load_brdf(path):
    """Open a run folder, a saved reconstruction (.npz), an RGL .bsdf or a MERL .binary as a `Brdf`.

    path may also be the name of a material, see `gonio.brdf.library`. Raises `gonio.brdf.BrdfFileError`.
    """
    from gonio.load import load_brdf as load

    return load(path)
