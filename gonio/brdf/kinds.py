"""Which class each kind of saved BRDF of this package is; `gonio.load` adds the reconstructions."""

from importlib import import_module

KINDS = {
    "lambert": "gonio.brdf.models.lambert:Lambert",
    "ggx": "gonio.brdf.models.microfacet:Ggx",
    "beckmann": "gonio.brdf.models.microfacet:Beckmann",
    "student": "gonio.brdf.models.student:Student",
    "abc": "gonio.brdf.models.abc:Abc",
    "mixture": "gonio.brdf.models.mixture:Mixture",
    "fitted": "gonio.brdf.models.fitted:FittedBrdf",
    "rgl": "gonio.brdf.tables.rgl:RglBrdf",
    "slices": "gonio.brdf.tables.slices:SlicesBrdf",
}


def class_of(kind: str):
    """The class of a kind, imported now. Raises KeyError for a kind that does not exist."""
    module, name = KINDS[kind].split(":")
    return getattr(import_module(module), name)
