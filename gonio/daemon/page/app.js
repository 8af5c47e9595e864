"use strict";
// The live page: what the daemon sends on /events, put where it belongs; two buttons that post.

const el = (id) => document.getElementById(id);
const token = location.search;
const dome = new Hemisphere(el("hemisphere"), el("scale"));
const lines = { acceptance: [], ess: [], error: [], free: [] };
const COLOURS = { acceptance: "#3fb68b", ess: "#5ab0ff", error: "#ffc857", free: "#8a97a8" };
let job = null, paused = false;

function duration(s) {
  if (s === null || s === undefined) return "–";
  s = Math.round(s);
  const two = (n) => String(n).padStart(2, "0");
  if (s < 60) return `${s} s`;
  return s < 3600 ? `${Math.floor(s / 60)}:${two(s % 60)} min` : `${Math.floor(s / 3600)}:${two(Math.floor((s % 3600) / 60))} h`;
}

function put(id, text) {
  if (el(id).textContent !== text) el(id).textContent = text;
}

function line(name, x, y) {
  const of = lines[name];
  if (y === null || y === undefined || (of.length && x <= of[of.length - 1][0])) return;
  of.push([x, y]);
  if (of.length > 600) lines[name] = of.filter((_, k) => k % 2 === 0 || k === of.length - 1);
  spark(name);
}

function spark(name) {
  const points = lines[name], [c, w, h] = fitted(el(`${name}-line`));
  if (points.length < 2) return;
  const x0 = points[0][0], x1 = points[points.length - 1][0];
  const ys = points.map((p) => p[1]), top = Math.max(...ys), low = Math.min(0, ...ys), span = top - low || 1;
  const at = (p) => [2 + ((w - 4) * (p[0] - x0)) / (x1 - x0), h - 3 - ((h - 6) * (p[1] - low)) / span];
  c.strokeStyle = COLOURS[name];
  c.lineWidth = 1.5;
  c.lineJoin = "round";
  c.beginPath();
  points.forEach((p, k) => (k ? c.lineTo(...at(p)) : c.moveTo(...at(p))));
  c.stroke();
}

function show(state) {
  const j = state.job, p = (j && j.progress) || null, found = (j && j.estimate) || {};
  put("rig", `${state.rig.name} · ${state.rig.depth}`);
  el("rig").title = el("rig").textContent; // a long one is cut
  badge(state.state);
  paused = state.state === "paused";
  put("pause", paused ? "Continue" : "Pause");
  el("pause").disabled = !(j && (j.run || j.asks) && j.ended === null && state.state !== "stopping");
  document.title = `${state.rig.name}: ${state.state}${p ? ` · ${p.measured}` : ""}`;
  if ((j && j.id) !== job) {
    job = j && j.id;
    for (const name of Object.keys(lines)) { lines[name] = []; spark(name); }
  }
  put("job", j ? `${j.kind} ${j.material || ""}${j.ended !== null ? " · ended" : ""}` : "no job yet");
  put("run", j && j.run ? `${j.run}${j.truth ? ` · shows: ${j.truth}` : ""}` : "");
  const bad = j && j.ended !== null && j.code !== 0 && j.code !== 130;
  const asks = j && j.ended === null && j.asks ? `Put in ${j.asks}, then Continue` : "";
  const text = j && j.ended !== null ? j.message || (j.result && j.result.reason) || "" : "";
  el("message").hidden = !text && !asks;
  el("message").className = bad ? "bad" : "";
  put("message", text ? `${j.kind} ended: ${text}` : asks);
  put("measured", p ? p.measured.toLocaleString("en") : "0");
  put("budget", p && p.budget ? `of ${p.budget.toLocaleString("en")} measurements` : "measurements");
  el("done").style.width = p && p.budget ? `${Math.min(100, (100 * p.measured) / p.budget)}%` : "0";
  put("rig_s", duration(p && p.rig_s));
  put("rig_left_s", duration(p && p.rig_left_s));
  put("wall_left_s", duration(p && p.wall_left_s));
  put("per_s", p ? `${p.per_s.toFixed(p.per_s < 10 ? 1 : 0)} /s` : "–");
  const error = found.energy_error ?? (j && j.estimating ? null : p && p.energy_error);
  put("acceptance", p ? `${(100 * p.acceptance).toFixed(0)} %` : "–");
  const none = j && j.estimating ? "…" : "–"; // the last estimate is being worked out: no earlier one stands for it
  put("ess", found.ess != null ? found.ess.toFixed(0) : none);
  put("error", error != null ? `${(100 * error).toFixed(1)} %` : none);
  put("free", p ? p.free.toLocaleString("en") : "–");
  if (p) {
    line("acceptance", p.measured, p.acceptance);
    line("free", p.measured, p.free);
    line("ess", found.measured, found.ess);
    line("error", found.measured, found.energy_error);
  }
  axes(state.rig.axes, state.pose_deg);
  devices(state.devices);
}

function badge(state) {
  put("state", state);
  el("state").className = `badge ${state === "connection lost" ? "lost" : state}`;
}

function axes(limits, pose) {
  const box = el("axes");
  if (!box.children.length) {
    for (const name of Object.keys(limits)) {
      const row = box.appendChild(document.createElement("div"));
      row.className = "axis";
      row.append(...["name", "track", "angle"].map((k) => Object.assign(document.createElement("div"), { className: k })));
      row.children[0].textContent = name;
      row.children[1].appendChild(document.createElement("div")).className = `at ${name === "light" ? "light" : ""}`;
    }
  }
  Object.entries(limits).forEach(([name, { lower_deg: low, upper_deg: high }], k) => {
    const [, track, angle] = box.children[k].children, a = pose && pose[name];
    angle.textContent = a == null ? "–" : `${a.toFixed(2)}°`;
    track.firstChild.style.left = a == null ? "50%" : `${Math.min(100, Math.max(0, (100 * (a - low)) / (high - low)))}%`;
    track.firstChild.style.visibility = a == null ? "hidden" : "visible";
  });
}

function devices(rows) {
  if (!rows.length) return;
  el("devices").replaceChildren(...rows.map((d) => Object.assign(document.createElement("li"), {
    className: d.ok ? "" : "bad", textContent: d.text ? `${d.name}: ${d.text}` : d.name,
  })));
}

async function post(what) {
  try {
    await fetch(what + token, { method: "POST" });
  } catch {
    badge("connection lost");
  }
}

el("pause").addEventListener("click", () => post(paused ? "continue" : "pause"));
el("stop").addEventListener("click", () => post("stop"));
const events = new EventSource("events" + token);
events.addEventListener("state", (e) => show(JSON.parse(e.data)));
events.addEventListener("samples", (e) => {
  const { rows, fresh } = JSON.parse(e.data);
  dome.add(rows, fresh);
});
events.addEventListener("error", () => badge("connection lost"));
