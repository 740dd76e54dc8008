// A picture grid drawn by hand: each node over the driver's view is dragged onto what the mirror is to show at it, and its
// neighbours follow as the normals of a surface do.

import { el } from "./dom.js";
import { fixed } from "./numbers.js";
import { copy } from "./state.js";
import { post } from "./wire.js";

const NEAR = 12; // CSS pixels from a node
const REACH = 1.2; // of the nodes' distance: how far neighbours follow
const SPANS = [8, 6]; // that a wanted view is met with while a hand draws

export class ViewGrid {
  constructor(store, stage, { fail, well }) {
    Object.assign(this, { store, stage, fail, well });
    this.on = false;
    this.draw_ = el("button", { type: "button", id: "draw-grid", "aria-pressed": "false", onclick: () => this.toggle(!this.on) }, "Draw on the picture");
    this.back = el("button", { type: "button", hidden: true, onclick: () => this.lawsAgain() }, "The laws again");
    this.about = el("p", { class: "unit" });
    this.element = el("details", { id: "wanted-view" }, el("summary", {}, "Wanted view"), el("div", { class: "rows" }, this.about, el("div", { class: "buttons" }, this.draw_, this.back)));
    stage.nodes = this;
    this.refresh();
  }

  // The grid of the specification, where it has one that a hand can draw.
  get target() {
    const { surface, target } = this.store.now.spec;
    return surface.method === "view" && target?.projection === "table" && Array.isArray(target.x_mm) && Array.isArray(target.azimuth_deg?.[0]) ? target : null;
  }

  // Drawn on for the first time, the grid is what the mirror at hand shows.
  async toggle(on) {
    this.well("grid");
    if (on && !this.target) {
      try {
        const { spec, look } = this.store.now, target = await post("/grid", JSON.stringify({ spec, look: { ...look, width: 640, height: 480 } }));
        this.store.settle();
        this.store.edit((now) => {
          now.spec.surface = { ...now.spec.surface, method: "view", spans: SPANS };
          now.spec.target = target;
          delete now.spec.limits?.curvature_percent; // it is held against laws
        });
      } catch (problem) { this.fail(problem, "grid"); return; }
    }
    this.on = on;
    this.refresh();
    this.stage.draw();
  }

  lawsAgain() {
    this.on = false;
    this.store.edit(({ spec }) => {
      spec.surface = { ...spec.surface, method: "decoupled", spans: "auto" };
      delete spec.target;
    });
    this.refresh();
    this.stage.draw();
  }

  refresh() {
    const view = this.store.now.spec.surface.method === "view";
    if (!this.target) this.on = false;
    this.draw_.setAttribute("aria-pressed", String(this.on));
    this.back.hidden = !view;
    const words = !view ? "The surface that comes closest to a view of your own: a grid over the mirror, each node dragged onto what is to be seen at it."
      : `The surface comes from the wanted view${this.target ? "" : ` (${this.store.now.spec.target?.projection})`}; the laws have no effect.`;
    if (this.about.textContent !== words) this.about.textContent = words;
  }

  // --- on the stage ---

  places({ camera, x, y, size }, eye) {
    const { x_mm: xs, y_mm: ys } = this.target;
    return ys.map((b) => xs.map((a) => {
      const [column, row] = camera.pixel([a - eye[0], b - eye[1], -eye[2]]);
      return [x + column * size, y + row * size];
    }));
  }

  draw(context, place, answer) {
    if (!this.on || !this.target) return;
    const at = this.places(place, answer.eyes_mm[place.eye]);
    context.save();
    const line = (points) => { context.beginPath(); for (const point of points) context.lineTo(...point); context.stroke(); };
    for (const [colour, width] of [["rgba(20,30,45,.45)", 3], ["rgba(255,255,255,.85)", 1]]) {
      context.strokeStyle = colour;
      context.lineWidth = width;
      at.forEach(line);
      at[0].forEach((_, i) => line(at.map((row) => row[i])));
    }
    at.forEach((row, j) => row.forEach(([x, y], i) => {
      const held = this.held && this.held.i === i && this.held.j === j;
      if (held) { context.strokeStyle = "#a34a08"; context.lineWidth = 2; line([[x, y], this.held.pointer]); }
      context.beginPath();
      context.arc(...(held ? this.held.pointer : [x, y]), held ? 7 : 5, 0, 2 * Math.PI);
      context.fillStyle = held ? "#f3cfa0" : "#fff";
      context.strokeStyle = held ? "#a34a08" : "#1c5fa8";
      context.lineWidth = 2;
      context.fill();
      context.stroke();
    }));
    context.restore();
  }

  // Whether the pointer takes a node.
  down(x, y, places, answer) {
    if (!this.on || !this.target) return false;
    for (const place of places.filter(({ kind }) => kind === "picture")) {
      const at = this.places(place, answer.eyes_mm[place.eye]);
      for (let j = 0; j < at.length; j++) for (let i = 0; i < at[j].length; i++) {
        if (Math.hypot(at[j][i][0] - x, at[j][i][1] - y) > NEAR) continue;
        this.held = { i, j, place, pointer: [x, y], from: [x, y], table: copy(this.target) };
        return true;
      }
    }
    return false;
  }

  // The node is to show what was seen where the pointer is, when it was taken.
  move(x, y) {
    const { i, j, place: { camera, x: left, y: top, size }, table } = this.held;
    this.held.pointer = [x, y];
    const [a, b] = camera.plane((x - left) / size, (y - top) / size);
    const { x_mm: xs, y_mm: ys } = table;
    const [across, up] = ["azimuth_deg", "elevation_deg"].map((key) => between(table, key, a, b) - table[key][j][i]);
    const s = REACH * Math.max((xs.at(-1) - xs[0]) / (xs.length - 1), (ys.at(-1) - ys[0]) / (ys.length - 1));
    // ∇((d·r)·exp(−r²/2s²)): d at the node itself, and without curl, as a change of normals must be. Of a change of one node
    // alone a surface can show but half.
    this.store.edit(({ spec: { target } }) => ys.forEach((y_, k) => xs.forEach((x_, l) => {
      const rx = (x_ - xs[i]) / s, ry = (y_ - ys[j]) / s, along = across * rx + up * ry, share = Math.exp(-0.5 * (rx * rx + ry * ry));
      target.azimuth_deg[k][l] = Number((table.azimuth_deg[k][l] + share * (across - along * rx)).toFixed(4));
      target.elevation_deg[k][l] = Number((table.elevation_deg[k][l] + share * (up - along * ry)).toFixed(4));
    })));
    this.stage.readout.textContent = `To be seen here: ${fixed(this.target.azimuth_deg[j][i], 2)}° across, ${fixed(this.target.elevation_deg[j][i], 2)}° up`;
    this.stage.draw();
  }

  up() {
    this.held = null;
    this.stage.leave();
  }
}

// A table's angle at a place, linear between its nodes; at its edge beyond it.
function between(table, key, x, y) {
  const { x_mm: xs, y_mm: ys, [key]: rows } = table;
  const at = (list, v) => {
    let k = 0;
    while (k < list.length - 2 && list[k + 1] < v) k++;
    return [k, Math.max(0, Math.min(1, (v - list[k]) / (list[k + 1] - list[k])))];
  };
  const [i, s] = at(xs, x), [j, t] = at(ys, y);
  return (1 - t) * ((1 - s) * rows[j][i] + s * rows[j][i + 1]) + t * ((1 - s) * rows[j + 1][i] + s * rows[j + 1][i + 1]);
}
