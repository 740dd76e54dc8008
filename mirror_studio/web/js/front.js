// The front of a study: its designs over two figures, and the one under the hand is the page's design.

import { TABLES } from "./colours.js";
import { el, find, roundStep, sharp, sizeOf, watch } from "./dom.js";
import { fixed } from "./numbers.js";
import { copy, get, put } from "./state.js";
import { post } from "./wire.js";

const PAD = { left: 44, right: 14, top: 6, bottom: 18 };
const RADIUS = 4.5;

// Whether a file is one of a front, by its name and first line.
export async function ofFront(file) {
  const name = file.name.toLowerCase();
  if (name === "optimise.json") return true;
  return name.endsWith(".csv") && /(^|,)status,cause(,|$)/.test((await file.slice(0, 65536).text()).split(/\r?\n/, 1)[0]);
}

export class Front {
  // shown(): there is a front, or none any more.
  constructor(panel, store, { shown, fail, well }) {
    Object.assign(this, { panel, store, shown, fail, well });
    this.chosen = null;
    const axis = (label) => el("select", { "aria-label": label, onchange: () => { this.sort(); this.draw(); } });
    [this.across, this.up, this.by] = ["Figure across", "Figure upwards", "Colour by"].map(axis);
    this.canvas = el("canvas", { "data-testid": "front-plot", tabindex: 0, role: "img", "aria-label": "The designs of the front over two figures: drag along them, or use the arrow keys" });
    this.slider = el("input", { type: "range", min: 0, value: 0, step: 1, "aria-label": "Along the front", oninput: () => this.choose(this.order[this.slider.valueAsNumber]) });
    this.about = el("p", { class: "edition" });
    this.body = el("tbody");
    panel.append(el("div", { class: "pick" }, this.up, el("button", { type: "button", "aria-label": "Put the front away", title: "Put it away", onclick: () => this.away() }, "×")),
      el("div", { class: "plot" }, this.canvas), el("div", { class: "pick across" }, this.across), this.slider,
      el("div", { class: "pick" }, this.about, el("span", {}, "colour"), this.by), el("div", { class: "lines" }, el("table", { "data-testid": "front-design" }, this.body)));
    watch(this.canvas, () => this.draw());
    const near = (event) => this.choose(this.nearest(event.offsetX, event.offsetY));
    this.canvas.addEventListener("pointerdown", (event) => {
      if (!this.front) return;
      this.canvas.setPointerCapture(event.pointerId);
      near(event);
    });
    this.canvas.addEventListener("pointermove", (event) => {
      if (event.buttons & 1) near(event);
      else if (this.front) this.canvas.title = this.inWords(this.nearest(event.offsetX, event.offsetY));
    });
    this.canvas.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -10, PageUp: 10 }[event.key];
      if (!step || !this.front) return;
      event.preventDefault();
      const at = this.chosen === null ? 0 : this.order.indexOf(this.chosen) + step;
      this.choose(this.order[Math.max(0, Math.min(this.order.length - 1, at))]);
    });
  }

  // Files of one front, dropped or chosen.
  async bring(files) {
    this.well("front");
    try {
      const table = files.find(({ name }) => name.toLowerCase().endsWith(".csv"));
      if (!table) throw new Error("optimise.json tells what a front is of: bring front.csv with it");
      const summary = files.find(({ name }) => name.toLowerCase() === "optimise.json");
      this.take(await post("/front", JSON.stringify({ name: table.name, table: await table.text(), summary: summary ? await summary.text() : null })));
    } catch (problem) { this.fail(problem, "front"); }
  }

  // The front of the study that the studio was started with.
  async ofStudio() {
    const answer = await fetch("/study").catch(() => null), content = await answer?.json().catch(() => null);
    if (content?.faults || !content) this.fail(new Error(content ? content.faults.join("\n") : "the study's front did not come"), "front");
    else this.take(content);
  }

  take(front) {
    this.front = front;
    this.chosen = null;
    this.base = front.spec ?? copy(this.store.now.spec);
    this.columns = [...front.measures.map((one, k) => ({ ...one, of: (i) => front.figures[i][k] })),
      ...front.keys.map((name, k) => ({ name, title: name, unit: "", decimals: null, key: true, of: (i) => front.values[i][k] }))];
    const [x, y, third] = [...new Set([...front.objectives, ...front.measures.map(({ name }) => name), ...front.keys])];
    const options = () => this.columns.map(({ name, title, unit }) => el("option", { value: name }, unit ? `${title}, ${unit}` : title));
    for (const [select, value] of [[this.across, x], [this.up, y ?? x]]) { select.replaceChildren(...options()); select.value = value; }
    this.by.replaceChildren(el("option", { value: "" }, "none"), ...options());
    this.by.value = front.objectives.length > 2 ? third : "";
    const scene = front.scene ? `; figures on a vehicle are of the scene ${front.scene}` : "";
    this.about.textContent = `${front.name}: ${front.values.length} designs${scene}${front.spec ? "" : ", varied from the design that was on the page"}`;
    this.about.title = front.spec ? this.about.textContent : "The table holds only what was varied. optimise.json, brought with it, says of what.";
    this.slider.max = front.values.length - 1;
    this.sort();
    this.fill();
    this.shown();
    this.draw();
  }

  away() {
    this.front = this.chosen = null;
    this.well("front");
    this.shown();
  }

  column(select) { return this.columns.find(({ name }) => name === select.value); }

  // Along the figure across.
  sort() {
    const { of } = this.column(this.across);
    this.order = this.front.values.map((_, i) => i).sort((a, b) => (of(a) ?? Infinity) - (of(b) ?? Infinity) || a - b);
    if (this.chosen !== null) this.slider.value = this.order.indexOf(this.chosen);
  }

  specAt(i) {
    const spec = copy(this.base);
    this.front.keys.forEach((key, k) => {
      const value = this.front.values[i][k], [, list, entry] = key.match(/^(.*)\.(\d+)$/) ?? [];
      if (list && Array.isArray(get(spec, list))) get(spec, list)[Number(entry)] = value;
      else put(spec, key, value);
    });
    return spec;
  }

  // The page's design becomes this one: what a hand drags over is shown at once, as with a slider.
  choose(i) {
    if (i === undefined || (i === this.chosen && !this.changed())) return;
    this.chosen = i;
    this.slider.value = this.order.indexOf(i);
    this.store.edit((now) => { now.spec = this.specAt(i); });
    this.fill();
    this.draw();
  }

  // Whether the design is no longer the chosen one.
  changed() { return this.chosen !== null && JSON.stringify(this.specAt(this.chosen)) !== JSON.stringify(this.store.now.spec); }

  refresh() {
    if (!this.front || this.panel.hidden) return;
    const changed = this.changed();
    if (changed !== this.drawnChanged) this.draw();
  }

  inWords(i) { return this.columns.filter(({ key }) => !key).map((column) => `${column.title}: ${told(column, i)}`).join("\n"); }

  fill() {
    const { chosen } = this;
    this.slider.setAttribute("aria-valuetext", chosen === null ? "no design chosen" : this.inWords(chosen));
    this.body.replaceChildren(...this.columns.map((column) => el("tr", { class: column.key ? "key" : "", "data-column": column.name },
      el("th", { scope: "row", title: column.definition ?? column.name }, column.title), el("td", {}, chosen === null ? "" : told(column, chosen)))));
  }

  // --- the plot ---

  nearest(x, y) {
    let best, off = Infinity;
    this.places?.forEach((place, i) => {
      const away = place ? (place[0] - x) ** 2 + (place[1] - y) ** 2 : Infinity;
      if (away < off) [best, off] = [i, away];
    });
    return best;
  }

  draw() {
    if (!this.front || !sizeOf(this.canvas)?.[0]) return;
    const { context, width, height } = sharp(this.canvas), { front } = this;
    const [x, y, by] = [this.across, this.up, this.by].map((select) => this.column(select));
    context.fillStyle = "#fff";
    context.fillRect(0, 0, width, height);
    context.font = "10px system-ui, sans-serif";
    context.strokeStyle = "#e7e9ed";
    context.fillStyle = "#5a6573";
    const line = (a, b, c, d) => { context.beginPath(); context.moveTo(a, b); context.lineTo(c, d); context.stroke(); };
    const ticks = (low, high, parts) => { const step = roundStep(high - low, parts), digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9)); return Array.from({ length: Math.floor(high / step) - Math.ceil(low / step) + 1 }, (_, k) => (Math.ceil(low / step) + k) * step).map((value) => [value, fixed(value, digits)]); };
    const [py, y0, y1] = scaled(y, front, height - PAD.bottom, PAD.top), upwards = ticks(y0, y1, Math.max(2, height / 60));
    const left = Math.max(PAD.left, 8 + Math.max(0, ...upwards.map(([, words]) => context.measureText(words).width)));
    const [px, x0, x1] = scaled(x, front, left, width - PAD.right);
    context.textAlign = "center";
    for (const [v, words] of ticks(x0, x1, Math.max(2, width / 80))) { line(px(v), PAD.top, px(v), height - PAD.bottom); context.fillText(words, px(v), height - PAD.bottom + 12); }
    context.textAlign = "right";
    for (const [v, words] of upwards) { line(left, py(v), width - PAD.right, py(v)); context.fillText(words, left - 4, py(v) + 3); }
    this.places = front.values.map((_, i) => [x.of(i), y.of(i)]).map(([a, b]) => (Number.isFinite(a) && Number.isFinite(b) ? [px(a), py(b)] : null));
    const colour = by ? shades(by, front) : () => "#1c5fa8";
    const dot = (i, radius) => { context.beginPath(); context.arc(...this.places[i], radius, 0, 2 * Math.PI); };
    for (const i of this.order) {
      if (!this.places[i]) continue;
      dot(i, RADIUS);
      context.fillStyle = colour(i);
      context.globalAlpha = 0.8;
      context.fill();
      context.globalAlpha = 1;
    }
    this.drawnChanged = this.changed();
    if (this.chosen !== null && this.places[this.chosen]) {
      dot(this.chosen, RADIUS + 3.5);
      context.lineWidth = 2.5;
      context.strokeStyle = this.drawnChanged ? "#8a949c" : "#a34a08";
      context.setLineDash(this.drawnChanged ? [3, 3] : []); // the design has been changed since
      context.stroke();
      context.setLineDash([]);
      context.lineWidth = 1;
    }
  }
}

function told({ of, decimals, unit }, i) {
  const value = of(i);
  if (value === null || value === undefined) return "–";
  if (typeof value !== "number") return String(value);
  return `${decimals === null ? String(Number(value.toPrecision(6))).replace("-", "−") : fixed(value, decimals)}${unit ? ` ${unit}` : ""}`;
}

function ends({ of }, front) {
  const values = front.values.map((_, i) => of(i)).filter(Number.isFinite);
  return values.length ? [Math.min(...values), Math.max(...values)] : [0, 1];
}

// From a figure to a place between two ends of the plot, with room beside the outermost designs.
function scaled(column, front, from, to) {
  let [low, high] = ends(column, front);
  const room = 0.05 * (high - low) || 0.05 * Math.abs(high) || 1;
  [low, high] = [low - room, high + room];
  return [(v) => from + ((v - low) / (high - low)) * (to - from), low, high];
}

function shades(column, front) {
  const [low, high] = ends(column, front);
  return (i) => {
    const value = column.of(i), k = 3 * Math.round((255 * (value - low)) / (high - low || 1));
    return Number.isFinite(value) ? `rgb(${TABLES.sequential.subarray(k, k + 3).join(",")})` : "#d4d4d0";
  };
}
