"""report.html: one self-contained page about a run."""

import base64
import html
import io
import os

import numpy as np
from matplotlib.figure import Figure

from gonio.atomic import write_text
from gonio.brdf import Brdf
from gonio.config.material import Material
from gonio.export.about import about
from gonio.export.netcdf import chain_arrays
from gonio.mcmc import diagnostics
from gonio.mcmc.proposals import DRAWN, FILL, KINDS
from gonio.reconstruct.integrals import EDGES
from gonio.reconstruct.samples import Samples
from gonio.render import figures
from gonio.render.verdict import Verdict, verdict
from gonio.run.record.integrals import AlbedoOfRun
from gonio.run.record.store import Store

STYLE = """
body{font:15px/1.5 system-ui,sans-serif;margin:2rem auto;max-width:64rem;padding:0 1rem;color:#1c1e21;background:#fff}
h1{font-size:1.5rem;margin-bottom:.2rem}h2{font-size:1.1rem;margin-top:2rem;border-bottom:1px solid #ddd}
table{border-collapse:collapse}td{padding:.1rem 1.2rem .1rem 0;vertical-align:top}td:first-child{color:#667}
img{max-width:100%}p{color:#445}
.good{color:#0a6b2d}.not-yet{color:#8a5a00}.unusable{color:#a01818}
"""


def write_report(
    path: str | os.PathLike[str],
    store: Store,
    material: Material,
    brdf: Brdf,
    truth: Brdf | None,
    flow=None,
    budget: dict | None = None,
) -> None:
    """The page: what was run, where was measured, how the chains did, what came out and how right it is.

    flow: the density (`log_prob`) that the run's flow ended with, if it had one. budget: of a calibrated rig, as
    `budget.json` has it.
    """
    m, steps = store.measured(), store.steps()
    good = np.isfinite(m.f).all(1)
    samples = Samples.of(m.seen[good, :3], m.seen[good, 3:], m.f[good], m.sigma[good], m.saturated[good])
    sphere, figures_of_merit = figures.spheres(brdf, truth)
    failed = int((~good).sum())
    imported = store.get("provenance", {}).get("imported")
    parts = [_verdict(verdict(brdf, samples, material, failed, imported is not None))]
    parts.append(_facts(store, material, m, steps, brdf) if imported is None else _source(imported, m, brdf))
    parts.append(
        _section(
            "Sphere under a sky and three lamps", sphere, ", ".join(f"{k} {v:.1f}" for k, v in figures_of_merit.items())
        )
    )
    if truth is not None:
        parts.append(_table("Beside the truth", _scores(brdf, truth) | _holes(truth)))
    parts.append(_albedos(AlbedoOfRun.of(store, material)))
    parts.append(_uncertainty(budget, material))
    parts.append(
        _section(
            "Slices in the plane of incidence",
            figures.slices(brdf, truth, material.channels),
            "Dashed: truth, where known.",
        )
    )
    parts.append(
        _section(
            "Half-vector grids", figures.half_grids(brdf, truth), "Mean of the channels of f cos θo, five decades."
        )
    )
    parts.append(
        _section(
            "Where was measured",
            figures.sample_cloud(samples, f"{len(samples)} measurements, rejected proposals included"),
        )
    )
    parts.append(_flow(store, samples, flow))
    if imported is None:
        parts.append(_chains(store, steps))
    parts.append(_reciprocity(samples))
    title = html.escape(material.name)
    page = f"<!doctype html><meta charset=utf-8><title>{title}</title><style>{STYLE}</style><h1>{title}</h1>" + "".join(
        parts
    )
    write_text(path, page)


def _verdict(v: Verdict) -> str:
    lines = "".join(f"<li>{html.escape(line)}" for line in v.findings)
    return f'<p class="{v.grade.replace(" ", "-")}"><strong>{html.escape(v.line)}</strong></p><ul>{lines}</ul>'


def _facts(store: Store, material: Material, m, steps, brdf: Brdf) -> str:
    p = store.get("provenance", {})
    chain_rows = steps["step"] >= 0
    failed = int((~np.isfinite(m.f).all(1)).sum())
    free = int((steps["id"][chain_rows] < 0).sum())
    rows = {
        "ended": store.get("ended") or "not yet",
        "measurements": f"{len(m.id)} ({failed} could not be measured, {int(m.saturated.sum())} saturated)",
        "steps": f"{int(chain_rows.sum())} in {material.sampler.chains} chain(s), {free} free",
        **_blocks(steps),
        "rig time": f"{m.rig_s.sum() / 60:.1f} min",
        "wall time": f"{m.wall_s.max(initial=0):.1f} s",
        "proposal": material.sampler.proposal,
        "rig": f"{p.get('rig')} ({p.get('depth')}{', simulated' if p.get('simulated') else ''})",
        "truth": p.get("truth") or "what lies on the rig",
        "made by": f"gonio {p.get('gonio')} {p.get('git')}, seed {p.get('seed')}",
    }
    rows |= {k: str(v) for k, v in about(material).items() if k != "name"}
    if p.get("stale"):
        rows["stale calibrations"] = "; ".join(p["stale"].values())
    estimate = getattr(brdf, "energy_error_estimate", None)
    if estimate is not None:
        rows["estimated energy error"] = f"{float(estimate):.3f} (no truth needed)"
    return _table("Run", rows)


def _source(imported: dict, m, brdf: Brdf) -> str:
    """Of a run that was imported: from what, and how the file was understood."""
    rows = {
        "imported from": f"{', '.join(imported['files'][:5])} ({imported['format']}, {len(imported['files'])} file(s))",
        "SHA-256": imported["sha256"][0],
        "readings": str(len(m.id)),
        "taken as": imported["quantity"],
        "columns": "; ".join(f"{k}: {v}" for k, v in imported["mapping"].items()),
    }
    rows |= {f"note {k + 1}": line for k, line in enumerate(imported["said"])}
    estimate = getattr(brdf, "energy_error_estimate", None)
    if estimate is not None:
        rows["estimated energy error"] = f"{float(estimate):.3f} (no truth needed)"
    return _table("Imported", rows)


def _blocks(steps) -> dict[str, str]:
    """What a run that designs its blocks measured besides the chains' steps."""
    drawn, filled = (int((steps["kind"] == kind).sum()) for kind in (DRAWN, FILL))
    if drawn + filled == 0:
        return {}
    blocks = len(np.unique(steps["chain"][steps["kind"] == FILL]))
    return {"blocks": f"{blocks} after the pilot: {drawn} more draws with weights, {filled} that fill holes"}


def _scores(brdf: Brdf, truth: Brdf) -> dict[str, str]:
    from gonio.evaluate import evaluate

    return {k: f"{v:.4f}" for k, v in evaluate(brdf, truth).items()}


def _holes(truth: Brdf) -> dict[str, str]:
    """What a measured table that serves as truth does not hold itself."""
    invalid = getattr(truth, "invalid_entries", None)
    if invalid is None or not invalid.any():
        return {}
    return {"entries of the truth not measured": f"{invalid.tolist()} by channel, filled from their neighbours"}


def _chains(store: Store, steps) -> str:
    of_chains = steps["step"] >= 0
    if not of_chains.any():
        return ""  # all that was measured was listed by hand
    accepted, measured = steps["accepted"][of_chains], steps["id"][of_chains] >= 0
    parts = [_section("Acceptance over time", figures.acceptance(steps["step"][of_chains], accepted, measured))]
    arrays = chain_arrays(store)
    theta_h, phi_d = arrays["theta_h"], arrays["phi_d"]
    if theta_h.size and theta_h.shape[1] > 20:
        kind = steps["kind"][of_chains]
        rows = {
            f"acceptance, {KINDS[k]}": f"{accepted[kind == k].mean():.1%} of {int((kind == k).sum())}"
            for k in np.unique(kind)
        }
        tau, trusted = diagnostics.autocorrelation_time(theta_h)
        short = "" if trusted else " (the chain is too short to trust it)"
        bulk, tail = diagnostics.ess_bulk(theta_h), diagnostics.ess_tail(theta_h)
        rows |= {
            "R-hat of θh": f"{diagnostics.rhat(theta_h):.4f}",
            "effective samples, bulk / tail": f"{bulk:.0f} / {tail:.0f}",
            "autocorrelation time of θh": f"{tau:.1f} steps{short}",
        }
        fresh = np.isfinite(steps["log_q"]) & of_chains & (steps["id"] >= 0) & steps["accepted"]
        log_w = (steps["log_p"] - steps["log_q"])[fresh]
        if len(log_w) > 25:
            rows["largest weight over mean, accepted draws"] = f"{diagnostics.weight_maximum(log_w):.1f}"
            rows["Pareto k"] = f"{diagnostics.pareto_k(log_w):.2f}"
        parts.append(_table("Chains", rows))
        parts.append(_section("Traces, ranks, running integral", figures.traces(theta_h, phi_d)))
    return "".join(parts)


def _albedos(a: AlbedoOfRun) -> str:
    if a.found is None:
        return ""
    figure = figures.albedos(EDGES, a.found.value, a.found.error, a.channels)
    text = "By all that was drawn, whatever the reconstruction is worth; bars: two standard errors."
    return _section("Albedo over θi", figure, text) + _table("Albedos ± standard error", a.rows())


def _uncertainty(budget: dict | None, material: Material) -> str:
    if budget is None:
        return ""
    rows = {
        f"DHR, θi {row['theta_i_deg']:g}°": "  ".join(
            f"{c} {v:.4f} ± {'?' if u is None else f'{u:.4f}'}"
            for c, v, u in list(zip(material.channels, row["value"], row["u"]))[:8]
        )
        for row in budget["dhr"]
    }
    rows |= {"not in it": "; ".join(budget["left_out"])} if budget["left_out"] else {}
    text = "Relative standard uncertainty (k = 1), median over pairs; all but the first are common to all readings."
    return _section("Uncertainty budget", figures.budget(budget["relative"]), text) + _table(
        "Reflectance, with u (k = 1)", rows
    )


def _flow(store: Store, samples: Samples, density) -> str:
    if density is None:
        return ""
    from gonio.render.flow_figure import flow_beside_samples

    elections = [text for _, kind, text in store.events() if kind == "flow"]
    rows = {f"election {k}": text for k, text in enumerate(elections, 1)}
    beside = _section("The flow beside the samples", flow_beside_samples(density, samples))
    return beside + _table("Elections of the flow: mean log density of the draws kept back", rows)


def _reciprocity(samples: Samples) -> str:
    return (
        f"<p>{len(samples)} measurements. Reciprocity, f(wi, wo) = f(wo, wi), and, of an isotropic sample, mirror "
        "symmetry about the plane of incidence were asked of the data, not forced on them.</p>"
    )


def _table(title: str, rows: dict[str, str]) -> str:
    body = "".join(f"<tr><td>{html.escape(str(k))}<td>{html.escape(str(v))}" for k, v in rows.items())
    return f"<h2>{title}</h2><table>{body}</table>"


def _section(title: str, figure: Figure, text: str = "") -> str:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=100)
    data = base64.b64encode(buffer.getvalue()).decode()
    words = f"<p>{html.escape(text)}</p>" if text else ""
    return f'<h2>{html.escape(title)}</h2>{words}<img alt="{html.escape(title)}" src="data:image/png;base64,{data}">'
