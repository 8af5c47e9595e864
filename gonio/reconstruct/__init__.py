"""Samples -> Brdf, by name. One module per model, each with `fit(samples, *, anisotropic, rng) -> Brdf`."""

import warnings
from importlib import import_module

import numpy as np

from gonio.brdf import Brdf
from gonio.reconstruct.clean import remarks
from gonio.reconstruct.errors import ReconstructionError, ReconstructionWarning
from gonio.reconstruct.samples import Samples

__all__ = ["MODELS", "ReconstructionError", "ReconstructionWarning", "Samples", "reconstruct"]

MODELS = {
    "auto": "gonio.reconstruct.splines.auto",
    "ggx": "gonio.reconstruct.fits.ggx",
    "lobes": "gonio.reconstruct.fits.lobes",
    "abc": "gonio.reconstruct.fits.abc",
    "thesis": "gonio.reconstruct.fits.thesis",
    "flow": "gonio.reconstruct.flows.flow",
    "flow_hd": "gonio.reconstruct.flows.flow_hd",
    "auto_flow": "gonio.reconstruct.flows.auto_flow",
}


def reconstruct(samples: Samples, model: str = "auto", *, anisotropic: bool = False, seed: int = 0) -> Brdf:
    """The BRDF that `samples` are measurements of.

    model is a key of MODELS. Raises `ReconstructionError` for samples too few or too poor, KeyError for a model
    that does not exist. Warns (`ReconstructionWarning`) of odd samples. The same samples and seed give the same BRDF.
    """
    fit = import_module(MODELS[model]).fit
    for line in remarks(samples):
        warnings.warn(line, ReconstructionWarning, stacklevel=2)
    return fit(samples, anisotropic=anisotropic, rng=np.random.default_rng(seed))
