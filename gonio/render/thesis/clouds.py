"""6.1: where a chain looks, by proposal: samples in (theta_h, theta_d, phi_d), rejected proposals included."""

import numpy as np
from matplotlib.figure import Figure

from gonio.brdf import Brdf
from gonio.config.material import Material
from gonio.geometry import Array, to_half_diff
from gonio.mcmc import make_sampler
from gonio.render.thesis.subject import Subject

BESIDE: dict[str, dict] = {  # the thesis's own proposals, run on the truth where it is known
    "simple PSS": {"proposal": "pss_simple", "boundary": "wrap"},
    "VNDF PSS, α 0.05": {"proposal": "pss_vndf", "alpha": 0.05, "boundary": "wrap"},
}
MOST = 10_000


def clouds(s: Subject) -> Figure:
    """The run's own samples; beside them, if the truth is known, as many of the thesis's proposals."""
    n = min(len(s.samples), MOST)
    panels = [(f"this run: {s.proposal}", s.samples.wi[:n], s.samples.wo[:n])]
    if s.truth is not None:
        panels += [(name, *walk(s.truth, section, n, s.seed)) for name, section in BESIDE.items()]
    figure = Figure(figsize=(4 * len(panels), 4.2), layout="constrained")
    for k, (name, wi, wo) in enumerate(panels):
        theta_h, _, theta_d, phi_d = (np.degrees(a) for a in to_half_diff(wi, wo))
        axis = figure.add_subplot(1, len(panels), k + 1, projection="3d")
        if s.density is not None and k == 0:
            colour, name = s.density.log_prob(wi, wo), f"{name}, colour: the flow's log density"
        else:
            colour = None
        axis.scatter(theta_h, theta_d, np.abs(phi_d), s=1, linewidths=0, c=colour)
        axis.set_xlabel("θh")
        axis.set_ylabel("θd")
        axis.set_zlabel("φd")
        axis.set_title(name, fontsize=9)
    return figure


def walk(truth: Brdf, section: dict, n: int, seed: int) -> tuple[Array, Array]:
    """wi, wo (n, 3) of the first n measurements that a sampler asks for."""
    target = {"channels": 0, "floor": 0.0}
    material = {"name": "walk", "channels": truth.channels, "seed": seed, "sampler": {**section, "target": target}}
    sampler = make_sampler(Material.model_validate(material))
    wi, wo, made = [], [], 0
    while made < n:
        batch = sampler.ask()
        sampler.tell(batch.ids, truth.eval(batch.wi, batch.wo))
        wi.append(batch.wi)
        wo.append(batch.wo)
        made += len(batch.ids)
    return np.concatenate(wi)[:n], np.concatenate(wo)[:n]
