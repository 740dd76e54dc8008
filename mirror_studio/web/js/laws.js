// The two laws as curves R(x): drawn as designed, realised and within the limit band, and dragged by their points.

import { el, roundStep, sizeOf, watch } from "./dom.js";
import { FLAT, MOST_ROWS } from "./numbers.js";

const PAD = { left: 40, right: 10, top: 20, bottom: 18 };
const LEAST_MM = 20; // to which a radius is dragged: nothing smaller is a mirror's

export class LawPlot {
  // laws: of each the keys by which its curve is dragged.
  constructor(section, axis, store, laws) {
    Object.assign(this, { section, axis, store, laws });
    this.held = null; // the scale while a point is dragged: it widens only for what lies beyond it
    this.svg = el("svg:svg", { class: "law", role: "group", "aria-label": `Law ${axis}(x): drag its points, or use the arrow keys on them` });
    this.grid = el("svg:g", { class: "grid" });
    this.flat = el("svg:text", { class: "title", "text-anchor": "middle" });
    this.band = el("svg:path", { class: "band" });
    this.real = el("svg:path", { class: "real" });
    this.line = el("svg:path", { class: "line" });
    this.guides = el("svg:path", { class: "guides" });
    this.handles = el("svg:g");
    this.svg.append(this.grid, this.band, this.guides, this.real, this.line, this.flat, this.handles);
    this.element = el("div", { class: "law-plot" }, this.svg);
    watch(this.element, () => this.draw());
  }

  // t of the law → x, and back.
  span() {
    const own = this.store.now.spec.horizontal.span_mm ?? this.answer?.box_mm ?? [-115, 115];
    return [own[0], own[1]];
  }
  xOf(t) { const [left, right] = this.span(); return right - t * (right - left); }
  tOf(x) { const [left, right] = this.span(); return Math.min(1, Math.max(0, (right - x) / (right - left))); }

  draw() {
    const { answer } = this;
    if (!answer) return;
    const [width, height] = sizeOf(this.element);
    if (!width || !height) return;
    this.svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    const { data: asked } = answer.arrays[`law_${this.axis.at(-1)}`];
    const { data: real } = answer.arrays[`real_${this.axis.at(-1)}`];
    const [x0, x1] = answer.box_mm;
    const points = this.points();
    const radii = [...asked, ...real].filter((k) => Math.abs(k) > FLAT).map((k) => 1000 / k).filter((r) => Math.abs(r) < 2e4);
    radii.push(...points.map((p) => p.r).filter(Number.isFinite));
    let low = Math.min(...radii), high = Math.max(...radii);
    if (!radii.length) [low, high] = [500, 1500];
    const room = Math.max(0.06 * (high - low), 0.04 * Math.abs(high), 10);
    const step = roundStep(high - low + 2 * room, 6); // round ends stay while a point moves a little
    let scale = [Math.floor((low - room) / step) * step, Math.ceil((high + room) / step) * step];
    if (this.held) {
      const { held } = this, beyond = points.some(({ r }) => r < held[0] || r > held[1]);
      scale = beyond ? [Math.min(held[0], scale[0]), Math.max(held[1], scale[1])] : held;
    }
    this.scale = scale;
    const px = (x) => PAD.left + ((x - x0) / (x1 - x0)) * (width - PAD.left - PAD.right);
    const py = (r) => PAD.top + ((scale[1] - r) / (scale[1] - scale[0])) * (height - PAD.top - PAD.bottom);
    this.toX = (p) => x0 + ((p - PAD.left) / (width - PAD.left - PAD.right)) * (x1 - x0);
    this.toR = (p) => scale[1] - ((p - PAD.top) / (height - PAD.top - PAD.bottom)) * (scale[1] - scale[0]);

    const axes = [width, height, x0, x1, ...scale].join();
    if (axes !== this.axesDrawn) {
      this.axesDrawn = axes;
      this.grid.replaceChildren(...this.axes(px, py, width, height, x0, x1, scale));
    }
    const place = (i) => x0 + (i / (asked.length - 1)) * (x1 - x0);
    const path = (values) => {
      let text = "", on = false;
      values.forEach((k, i) => {
        const r = Math.abs(k) > FLAT ? 1000 / k : Infinity;
        if (Math.abs(r) > 1e6) { on = false; return; }
        text += `${on ? "L" : "M"}${px(place(i)).toFixed(1)},${py(r).toFixed(1)}`;
        on = true;
      });
      return text;
    };
    const flat = asked.every((k) => Math.abs(k) <= FLAT);
    this.line.setAttribute("d", flat ? `M${px(x0).toFixed(1)},${PAD.top}H${px(x1).toFixed(1)}` : path(asked));
    this.flat.textContent = flat ? "flat (R = ∞)" : "";
    this.flat.setAttribute("x", 0.5 * (px(x0) + px(x1)));
    this.flat.setAttribute("y", PAD.top + 14);
    this.real.setAttribute("d", path(real));
    // The limit is of the curvature: R/(1 ± p).
    const limit = this.store.now.spec.limits?.curvature_percent;
    let band = "";
    if (limit && asked.every((k) => Math.abs(k) > FLAT)) {
      const edge = (sign) => Array.from(asked, (k, i) => `${px(place(i)).toFixed(1)},${py(1000 / (k * (1 + (sign * limit) / 100))).toFixed(1)}`);
      band = `M${edge(1).join("L")}L${edge(-1).reverse().join("L")}Z`;
    }
    this.band.setAttribute("d", band);
    this.guides.setAttribute("d", points.filter((p) => p.onAxis).map((p) => `M${px(p.x).toFixed(1)},${PAD.top}V${height - PAD.bottom}`).join(""));
    this.place(points, px, (point) => (point.onAxis ? height - PAD.bottom : py(point.r)));
  }

  axes(px, py, width, height, x0, x1, scale) {
    const parts = [];
    const step = roundStep(scale[1] - scale[0], 3);
    for (let r = Math.ceil(scale[0] / step) * step; r <= scale[1]; r += step) {
      parts.push(el("svg:line", { x1: PAD.left, x2: width - PAD.right, y1: py(r), y2: py(r) }),
        Object.assign(el("svg:text", { x: PAD.left - 5, y: py(r) + 3.5, "text-anchor": "end" }), { textContent: Math.round(r) }));
    }
    const stepX = roundStep(x1 - x0, 5);
    for (let x = Math.ceil(x0 / stepX) * stepX; x <= x1; x += stepX) {
      parts.push(el("svg:line", { x1: px(x), x2: px(x), y1: PAD.top, y2: height - PAD.bottom }),
        Object.assign(el("svg:text", { x: px(x), y: height - 5, "text-anchor": "middle" }), { textContent: Math.round(x) }));
    }
    parts.push(Object.assign(el("svg:text", { x: PAD.left, y: 12, class: "title" }),
      { textContent: `${this.axis} (mm) over x (mm)` }));
    return parts;
  }

  // The points by which the law is dragged; where it is flat there is none.
  points() { return this.all().filter((point) => point.onAxis || Number.isFinite(point.r)); }

  // Where they are, which keys they stand for, and what a move does.
  all() {
    const law = this.store.now.spec[this.section], { section } = this;
    const [x0, x1] = this.answer.box_mm;
    const solved = this.answer.matched ?? {}, { points = [] } = this.laws[law.law] ?? {};
    const along = points.filter(({ at }) => at === "t").map(({ key }) => key); // in rising t
    const t = (key) => (typeof law[key] === "number" ? law[key] : solved[key] ?? 0.5);
    const found = points.map(({ key, at, label }) => {
      const name = { id: key, label: label.replaceAll("{axis}", this.axis) };
      if (at === "t") {
        const i = along.indexOf(key), low = i ? t(along[i - 1]) + 0.01 : 0, high = i + 1 < along.length ? t(along[i + 1]) - 0.01 : 1;
        return { ...name, x: this.xOf(t(key)), onAxis: true, solved: law[key] === "match", move: (x) => this.along(x, key, low, high) };
      }
      const r = law[key] === "inf" ? Infinity : law[key];
      const x = { right: Math.min(this.xOf(0), x1), left: Math.max(this.xOf(1), x0), everywhere: 0.5 * (x0 + x1) }[at];
      return { ...name, x, r, move: (to, radius) => { this.store.now.spec[section][key] = radius; } };
    });
    if (!law.x_mm || law.x_mm.length > MOST_ROWS) return found;
    const radii = law.radius_mm?.map((r) => (typeof r === "number" ? r : Infinity)) ?? law.curvature_per_mm.map((k) => (Math.abs(1000 * k) > FLAT ? 1 / k : Infinity));
    return [...found, ...law.x_mm.map((x, i) => ({ id: `${i}`, label: `${this.axis} at x = ${x}`, x, r: radii[i],
      move: (to, r) => this.node(i, to, r) }))];
  }

  along(x, key, low, high) {
    const law = this.store.now.spec[this.section];
    law[key] = Math.round(1e4 * Math.min(high, Math.max(low, this.tOf(x)))) / 1e4;
    if (key === this.laws[law.law]?.open && law.match) delete law.match;
  }

  node(i, x, r) {
    const law = this.store.now.spec[this.section];
    if (i > 0 && i < law.x_mm.length - 1) {
      law.x_mm[i] = Math.round(10 * Math.min(law.x_mm[i + 1] - 0.5, Math.max(law.x_mm[i - 1] + 0.5, x))) / 10;
    }
    if (law.radius_mm) law.radius_mm[i] = r;
    else law.curvature_per_mm[i] = 1 / r;
  }

  place(points, px, py) {
    const old = new Map([...this.handles.children].map((child) => [child.dataset.id, child]));
    points.forEach((point) => {
      let handle = old.get(point.id);
      old.delete(point.id);
      if (!handle) {
        handle = el("svg:circle", { r: 6, tabindex: 0, role: "slider", "data-id": point.id, class: "handle" });
        handle.append(el("svg:title"));
        handle.addEventListener("pointerdown", (event) => this.drag(event, handle));
        handle.addEventListener("keydown", (event) => this.key(event, handle));
        this.handles.append(handle);
      }
      handle.point = point;
      handle.setAttribute("cx", px(point.x));
      handle.setAttribute("cy", py(point));
      handle.classList.toggle("sideways", Boolean(point.onAxis));
      handle.classList.toggle("solved", Boolean(point.solved));
      handle.setAttribute("aria-label", point.label);
      handle.setAttribute("aria-valuenow", point.onAxis ? point.x.toFixed(1) : point.r.toFixed(0));
      const at = `${point.onAxis ? "" : `${point.r.toFixed(0)} mm at `}x = ${point.x.toFixed(1)} mm${point.solved ? ", solved" : ""}`;
      handle.setAttribute("aria-valuetext", at);
      handle.firstChild.textContent = `${point.label}: ${at}`;
    });
    for (const handle of old.values()) handle.remove();
  }

  drag(event, handle) {
    event.preventDefault();
    handle.focus();
    handle.setPointerCapture(event.pointerId);
    this.held = this.scale;
    const box = this.svg.getBoundingClientRect();
    const { toX, toR } = this, { r: from } = handle.point; // as at the beginning: one place of the pointer is one radius
    const move = (e) => {
      const r = sameSide(from, Math.round(toR(e.clientY - box.top)));
      this.store.edit(() => handle.point.move(toX(e.clientX - box.left), r));
      this.draw();
    };
    const up = () => {
      handle.removeEventListener("pointermove", move);
      this.held = null;
      this.draw();
    };
    handle.addEventListener("pointermove", move);
    handle.addEventListener("pointerup", up, { once: true });
    handle.addEventListener("pointercancel", up, { once: true });
  }

  key(event, handle) {
    const size = event.shiftKey ? 10 : 1;
    const dx = { ArrowLeft: -1, ArrowRight: 1 }[event.key] ?? 0, dr = { ArrowUp: 5, ArrowDown: -5, PageUp: 50, PageDown: -50 }[event.key] ?? 0;
    if (!dx && !dr) return;
    event.preventDefault();
    const { point } = handle;
    this.store.edit(() => point.move(point.x + size * dx, sameSide(point.r, Math.round(point.r + size * dr))));
    this.draw();
  }
}

// Convex stays convex and concave concave: between them lies no radius.
function sameSide(from, to) {
  const least = Math.min(LEAST_MM, Math.abs(from));
  return from > 0 ? Math.max(least, to) : Math.min(-least, to);
}
