"""Which class each kind of saved BRDF of this package is; `gonio.load` adds the reconstructions."""

from importlib import import_module

KINDS = {
    "lambert": "gonio.brdf.lambert:Lambert",
    "ggx": "gonio.brdf.microfacet:Ggx",
    "beckmann": "gonio.brdf.microfacet:Beckmann",
    "student": "gonio.brdf.student:Student",
    "abc": "gonio.brdf.abc:Abc",
    "mixture": "gonio.brdf.mixture:Mixture",
    "fitted": "gonio.brdf.fitted:FittedBrdf",
    "rgl": "gonio.brdf.rgl:RglBrdf",
    "slices": "gonio.brdf.slices:SlicesBrdf",
}


def class_of(kind: str):
    """The class of a kind, imported now. Raises KeyError for a kind that does not exist."""
    module, name = KINDS[kind].split(":")
    return getattr(import_module(module), name)
