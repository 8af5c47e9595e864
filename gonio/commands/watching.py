"""A daemon's state in lines for a terminal."""

from typing import Any

from gonio.commands.progress import duration

BAR = 30


def text_of(state: dict[str, Any]) -> str:
    """Rig, job, progress, pose, devices."""
    rig, job = state["rig"], state["job"]
    lines = [f"rig      {rig['name']} ({rig['depth']})   {state['state']}"]
    if job is not None:
        lines += _job(job)
    if (queue := state.get("queue")) and (queue["active"] or queue["waiting"]):
        lines.append(f"queue    {queue['waiting']} waiting{'' if queue['active'] else '; `gonio queue run` begins'}")
    if state["pose_deg"]:
        lines.append("pose     " + "  ".join(f"{k} {v:.2f}" for k, v in state["pose_deg"].items()) + "  degrees")
    for d in state["devices"]:
        lines.append(f"{'ok ' if d['ok'] else 'BAD'}      {d['name']}{': ' if d['text'] else ''}{d['text']}")
    return "\n".join(lines)


def _job(job: dict[str, Any]) -> list[str]:
    lines = [f"job      {job['id']}: {job['kind']} {job.get('material', '')}".rstrip()]
    if job.get("asks"):
        lines.append(f"put in   {job['asks']}, then `gonio queue ready`")
    if "run" in job:
        lines.append(f"run      {job['run']}")
    if (p := job.get("progress")) is not None:
        of = f" of {p['budget']}" if p["budget"] else ""
        share = p["measured"] / p["budget"] if p["budget"] else 0.0
        bar = f"   [{'#' * round(BAR * share):{BAR}}]" if p["budget"] else ""
        lines.append(f"measured {p['measured']}{of}{bar}")
        lines.append(f"chain    acceptance {p['acceptance']:.0%}   free {p['free']}   {_estimate(job, p)}")
        left = "" if p["rig_left_s"] is None else f", {duration(p['rig_left_s'])} left"
        eta = "" if p["wall_left_s"] is None else f"   ETA {duration(p['wall_left_s'])}"
        lines.append(f"time     rig {duration(p['rig_s'])}{left}{eta}   {p['per_s']:.1f} measurements/s")
    if job["ended"] is not None:
        end = job["message"] or (job.get("result") or {}).get("reason", "done")
        lines.append(f"ended    {end}" + (f" (exit code {job['code']})" if job["code"] else ""))
    return lines


def _estimate(job: dict[str, Any], p: dict[str, Any]) -> str:
    if job.get("estimating"):  # the last one, of all measurements: no earlier one stands for it
        return "ESS …   error …"
    found = job.get("estimate") or {}
    error = found.get("energy_error") if found.get("energy_error") is not None else p["energy_error"]
    ess = "-" if found.get("ess") is None else f"{found['ess']:.0f}"
    return f"ESS {ess}   error ~{'-' if error is None else f'{error:.3f}'}"
