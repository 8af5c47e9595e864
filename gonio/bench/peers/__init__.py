"""Ways to measure a material, ours among them: each file looks where its source says, through the same `Session`.

A peer is a module with `look(session, n, rng)`: about n measurements, in the order it would take them; and, where its
source reconstructs in a way of its own, `own(session) -> Brdf`. All are for isotropic materials.
"""

from importlib import import_module
from types import ModuleType

PEERS = {
    "ours": "gonio.bench.peers.ours",
    "chain of before": "gonio.bench.peers.energy_chain",
    "sobol list": "gonio.bench.peers.sobol_list",
    "ggx importance": "gonio.bench.peers.ggx_importance",
    "stratified": "gonio.bench.peers.stratified",
    "merl grid": "gonio.bench.peers.merl_grid",
    "rgl grid": "gonio.bench.peers.rgl_grid",
    "nielsen pca": "gonio.bench.peers.nielsen",
    "greedy gp": "gonio.bench.peers.greedy_gp",
    "thesis": "gonio.bench.peers.thesis",
}


def peer(name: str) -> ModuleType:
    """Raises KeyError."""
    return import_module(PEERS[name])
