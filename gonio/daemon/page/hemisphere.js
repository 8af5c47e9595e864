"use strict";
// The hemisphere above the sample, seen from the side: measured directions, and both arms where they are now.
// A row of samples is [theta_i, theta_o, turn, log10 f or null, saturated]; the light is turned to azimuth 180 degrees.

const STOPS = [
  [0.0, 62, 58, 140], [0.2, 104, 48, 146], [0.4, 163, 47, 117], [0.6, 222, 80, 80], [0.8, 248, 149, 64], [1.0, 252, 245, 170],
];

function shade(t) {
  t = Math.min(1, Math.max(0, t));
  let k = 1;
  while (k < STOPS.length - 1 && t > STOPS[k][0]) k++;
  const a = STOPS[k - 1], b = STOPS[k], s = (t - a[0]) / (b[0] - a[0]);
  return `rgb(${[1, 2, 3].map((c) => Math.round(a[c] + s * (b[c] - a[c]))).join(",")})`;
}

const SHADES = Array.from({ length: 48 }, (_, k) => shade(k / 47));

function fitted(canvas) {
  // the canvas at the screen's own resolution: [context, width, height] in CSS pixels
  const ratio = window.devicePixelRatio || 1, w = canvas.clientWidth, h = canvas.clientHeight;
  if (canvas.width !== Math.round(w * ratio) || canvas.height !== Math.round(h * ratio)) {
    canvas.width = Math.round(w * ratio);
    canvas.height = Math.round(h * ratio);
  }
  const c = canvas.getContext("2d");
  c.setTransform(ratio, 0, 0, ratio, 0, 0);
  c.clearRect(0, 0, w, h);
  return [c, w, h];
}

class Hemisphere {
  constructor(canvas, scale) {
    this.canvas = canvas;
    this.scale = scale;
    this.rows = [];
    this.yaw = -0.42;
    this.pitch = 0.52;
    this.low = -2;
    this.high = 1;
    this.dirty = true;
    let from = null;
    canvas.addEventListener("pointerdown", (e) => { from = [e.clientX, e.clientY]; canvas.setPointerCapture(e.pointerId); });
    canvas.addEventListener("pointerup", () => { from = null; });
    canvas.addEventListener("pointermove", (e) => {
      if (!from) return;
      this.yaw += (e.clientX - from[0]) * 0.008;
      this.pitch = Math.min(1.57, Math.max(0.05, this.pitch + (e.clientY - from[1]) * 0.006));
      from = [e.clientX, e.clientY];
      this.dirty = true;
    });
    window.addEventListener("resize", () => { this.dirty = true; });
    const frame = () => {
      if (this.dirty) { this.dirty = false; this.draw(); }
      requestAnimationFrame(frame);
    };
    frame();
  }

  add(rows, fresh) {
    if (fresh) this.rows = [];
    for (const r of rows) this.rows.push(r);
    if (this.rows.length > 20000) this.rows.splice(0, this.rows.length - 20000);
    const logs = this.rows.filter((r) => r[3] !== null).map((r) => r[3]).sort((a, b) => a - b);
    if (logs.length > 4) {
      this.low = logs[Math.floor(0.02 * logs.length)];
      this.high = Math.max(logs[Math.floor(0.98 * (logs.length - 1))], this.low + 0.5);
    }
    this.dirty = true;
  }

  project(x, y, z) {
    // [right, up, towards the viewer], unit sphere
    const a = x * Math.cos(this.yaw) - y * Math.sin(this.yaw), b = x * Math.sin(this.yaw) + y * Math.cos(this.yaw);
    return [a, b * Math.sin(this.pitch) + z * Math.cos(this.pitch), z * Math.sin(this.pitch) - b * Math.cos(this.pitch)];
  }

  draw() {
    const [c, w, h] = fitted(this.canvas);
    // the dome's outline reaches R above its centre, its rim R sin(pitch) below; arms reach a little further
    const rim = Math.sin(this.pitch), R = Math.min(w / 2.6, (h - 30) / (1.16 + rim)), X = w / 2;
    const Y = (h + R * (1.1 - rim)) / 2;
    const at = (x, y, z) => { const p = this.project(x, y, z); return [X + R * p[0], Y - R * p[1], p[2]]; };
    const path = (points) => {
      c.beginPath();
      points.forEach((p, k) => (k ? c.lineTo(p[0], p[1]) : c.moveTo(p[0], p[1])));
      c.stroke();
    };
    const turn = (n, f) => Array.from({ length: n + 1 }, (_, k) => f(k / n));
    this._ground(c, at, path, turn);
    c.strokeStyle = "#313e50";
    c.beginPath();
    c.arc(X, Y, R, Math.PI, 2 * Math.PI);
    c.stroke();
    const last = this.rows[this.rows.length - 1];
    const light = last && [-Math.sin(last[0]), 0, Math.cos(last[0])];
    const eye = last && Hemisphere.wo(last);
    this._points(c, at);
    if (last) {
      this._arm(c, at, light, "#ffc857", "light");
      this._arm(c, at, eye, "#5ab0ff", "detector");
    }
    this._scale();
  }

  static wo(row) {
    const s = Math.sin(row[1]), phi = Math.PI + row[2];
    return [s * Math.cos(phi), s * Math.sin(phi), Math.cos(row[1])];
  }

  _ground(c, at, path, turn) {
    const ring = (theta) => turn(96, (t) => at(Math.sin(theta) * Math.cos(2 * Math.PI * t), Math.sin(theta) * Math.sin(2 * Math.PI * t), Math.cos(theta)));
    c.fillStyle = "#10161f";
    c.beginPath();
    ring(Math.PI / 2).forEach((p, k) => (k ? c.lineTo(p[0], p[1]) : c.moveTo(p[0], p[1])));
    c.fill();
    c.lineWidth = 1;
    for (const d of [30, 60, 90]) {
      c.strokeStyle = d === 90 ? "#3c4a5e" : "#232d3a";
      path(ring((d * Math.PI) / 180));
    }
    c.strokeStyle = "#1d2632";
    for (let k = 0; k < 12; k++) {
      const phi = (k * Math.PI) / 6;
      path(turn(24, (t) => { const s = Math.sin((t * Math.PI) / 2); return at(s * Math.cos(phi), s * Math.sin(phi), Math.cos((t * Math.PI) / 2)); }));
    }
    c.fillStyle = "#2b3644";
    c.strokeStyle = "#56657a";
    c.beginPath();
    turn(40, (t) => at(0.1 * Math.cos(2 * Math.PI * t), 0.1 * Math.sin(2 * Math.PI * t), 0)).forEach((p, k) => (k ? c.lineTo(p[0], p[1]) : c.moveTo(p[0], p[1])));
    c.fill();
    c.stroke();
    c.fillStyle = "#5d6b7e";
    c.font = "11px system-ui, sans-serif";
    for (const d of [30, 60]) {
      const p = at(0, -Math.sin((d * Math.PI) / 180), Math.cos((d * Math.PI) / 180));
      c.fillText(`${d}°`, p[0] + 3, p[1] - 3);
    }
  }

  _points(c, at) {
    const n = this.rows.length, size = n > 6000 ? 2 : n > 1500 ? 3 : 4;
    const order = [];
    for (let k = 0; k < n; k++) {
      const p = at(...Hemisphere.wo(this.rows[k]));
      order.push([p[2], p[0], p[1], k]);
    }
    order.sort((a, b) => a[0] - b[0]);
    for (const [depth, x, y, k] of order) {
      const v = this.rows[k][3];
      const young = Math.max(0, 1 - (n - 1 - k) / 30);
      c.globalAlpha = v === null ? 0.5 : 0.55 + 0.45 * Math.max(0, Math.min(1, (depth + 1) / 1.6));
      c.fillStyle = v === null ? "#56657a" : SHADES[Math.round(47 * Math.min(1, Math.max(0, (v - this.low) / (this.high - this.low))))];
      const s = size + 3 * young;
      c.beginPath();
      c.arc(x, y, s / 2, 0, 7);
      c.fill();
    }
    c.globalAlpha = 1;
  }

  _arm(c, at, d, colour, name) {
    const p = at(1.16 * d[0], 1.16 * d[1], 1.16 * d[2]), o = at(0, 0, 0);
    const fade = c.createLinearGradient(p[0], p[1], o[0], o[1]);
    fade.addColorStop(0, colour);
    fade.addColorStop(1, colour + "22");
    c.strokeStyle = fade;
    c.lineWidth = 2.5;
    c.beginPath();
    c.moveTo(p[0], p[1]);
    c.lineTo(o[0], o[1]);
    c.stroke();
    c.fillStyle = colour;
    c.strokeStyle = "#0d1117";
    c.lineWidth = 2;
    c.beginPath();
    c.arc(p[0], p[1], 8, 0, 7);
    c.fill();
    c.stroke();
    c.font = "600 12px system-ui, sans-serif";
    c.fillText(name, p[0] + 12, p[1] + 4);
  }

  _scale() {
    const [c, w] = fitted(this.scale);
    const fade = c.createLinearGradient(6, 0, w - 6, 0);
    for (let k = 0; k <= 10; k++) fade.addColorStop(k / 10, shade(k / 10));
    c.fillStyle = fade;
    c.beginPath();
    c.roundRect(6, 2, w - 12, 10, 5);
    c.fill();
    c.fillStyle = "#8a97a8";
    c.font = "11px system-ui, sans-serif";
    c.textAlign = "center";
    const span = this.high - this.low, step = span > 3 ? 1 : span > 1.2 ? 0.5 : 0.25;
    for (let v = Math.ceil(this.low / step) * step; v <= this.high + 1e-9; v += step) {
      const x = 6 + ((w - 12) * (v - this.low)) / span;
      c.fillRect(x, 13, 1, 4);
      c.fillText(Number((10 ** v).toPrecision(2)).toString(), Math.min(w - 18, Math.max(18, x)), 29);
    }
  }
}
