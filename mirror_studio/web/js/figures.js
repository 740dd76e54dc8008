// The figures beside those of the pinned design, with the limits that the user sets for them.

import { el } from "./dom.js";
import { LIMITS, limitOf, setLimit } from "./state.js";
import { fixed } from "./numbers.js";

const deg = (v, more = 0) => fixed(v, 2 + more), pct = deg, mm = (v, more = 0) => fixed(v, more);

export const FIGURES = [
  { id: "h-fov", label: "H-FOV, section", unit: "°", of: (a) => a.figures.h_fov_deg.section, show: deg,
    about: "Horizontal field of view as table 1 of the paper has it: the horizontal section alone, the eye on the axis through its centre at the eye's distance; the angle between the rays reflected at its two edges." },
  { id: "h-fov-traced", label: "H-FOV, traced", unit: "°", of: (a) => a.figures.h_fov_deg.traced, show: deg,
    about: "The same with the eye where it really sits: the angle between the rays reflected at (±width/2, 0)." },
  { id: "v-fov", label: "V-FOV left, section", unit: "°", of: (a) => a.figures.v_fov_left_deg.section, show: deg,
    about: "Vertical field of view at the left edge as table 1 has it: the circle of radius Ry there over the left height, the eye on its axis." },
  { id: "v-fov-traced", label: "V-FOV left, traced", unit: "°", of: (a) => a.figures.v_fov_left_deg.traced, show: deg,
    about: "The same with the eye where it really sits: the angle between the rays reflected at the left edge's two corners before rounding." },
  { id: "straightness", label: "Lane straightness", unit: "%", of: (a) => a.figures.lane_straightness_percent.traced, show: pct,
    about: "Table 1: (|Δy of the lane's image| − |Δy of its tangent at the right edge|) over the latter, across the mirror, by exact rays. The more the lane bends, the larger." },
  { id: "rx-smallest", label: "Rx, smallest", unit: "mm", of: (a) => a.radii.rx_smallest_mm, show: mm,
    about: "The horizontal radius where the realised surface is bent most, over the outline's box." },
  { id: "ry-smallest", label: "Ry, smallest", unit: "mm", of: (a) => a.radii.ry_smallest_mm, show: mm,
    about: "The vertical radius where the realised surface is bent most, over the outline's box." },
  { id: "k1", label: "k₁ off, at most", unit: "%", fine: true, of: (a) => a.deviations?.k1_max_percent, show: pct,
    about: "Largest deviation of the larger principal curvature from the laws over the mirror, signed; worked out when the hand rests." },
  { id: "k2", label: "k₂ off, at most", unit: "%", fine: true, of: (a) => a.deviations?.k2_max_percent, show: pct,
    about: "Largest deviation of the smaller principal curvature from the laws over the mirror, signed; worked out when the hand rests." },
  { id: "shape", label: "Shape off, RMS", unit: "%", fine: true, of: (a) => a.deviations?.shape_rms_percent, show: pct,
    about: "RMS deviation of the whole shape operator from the laws; worked out when the hand rests." },
  ...[4, 10, 20, 30].map((at, i) => ({ id: `width-${at}`, label: `Ground seen ${at} m behind`, unit: "m", view: "road", fine: true,
    of: (a) => a.road?.figures?.seen_width_m[i]?.[1], show: deg,
    about: `Width of the ground seen by either eye ${at} m behind the eyes, outward of the plane of the host vehicle's flank and without a gap.` })),
  { id: "nearest", label: "Nearest ground at the flank", unit: "m", view: "road", fine: true, of: (a) => a.road?.figures?.nearest_m, show: deg,
    about: "Smallest distance behind the eyes at which the ground 0.1 m beside the host vehicle's flank is seen by either eye." },
  { id: "blind", label: "Lane beside in no view", unit: "m", view: "road", fine: true, of: (a) => a.road?.figures?.blind_length_m, show: deg,
    about: "Length along the middle of the lane beside, on the ground from 5 m ahead of the eyes to 60 m behind, that is neither seen in the mirror by either eye nor before the limit of direct view, 95° from straight ahead." },
];
// In the road's view those of the picture plane stay away, unless a limit is set for them.
const OF_THE_PLANE = ["h-fov-traced", "v-fov-traced", "rx-smallest", "ry-smallest"];

// What is there already is left alone: to write it again would make the page lay the table out again.
function say(cell, text, kind = "") {
  if (cell.textContent !== text) cell.textContent = text;
  if (cell.className !== kind) cell.className = kind;
}

const misses = (value, [least, most]) => (least !== null && value < least) || (most !== null && value > most);

// A value that misses its limit is shown in digits that show the miss: 45.504 beside "at most 45.5".
function telling(value, pair, show) {
  let more = 0;
  if (pair && misses(value, pair)) while (more < 14 && !misses(Number(show(value, more).replace("−", "-")), pair)) more += 1;
  return show(value, more);
}

const signed = (text) => (text.startsWith("−") ? text : Number(text) === 0 ? `±${text}` : `+${text}`);

export class Figures {
  constructor(table, store) {
    this.table = table;
    this.store = store;
    this.cells = {};
    this.more = []; // measures beyond those of FIGURES
    this.last = {}; // of figures that are worked out when the hand rests
    this.typed = null; // the limit that is being entered
    table.addEventListener("input", (event) => { this.typed = event.target; }, true);
    table.addEventListener("change", () => this.inForce());
    const head = (words) => el("th", { scope: "row" }, words);
    const row = (name, words) => {
      const line = el("tr", { class: name }, head(words));
      for (const figure of FIGURES) line.append((this.cells[`${name} ${figure.id}`] = el("td")));
      return line;
    };
    const top = el("tr", {}, el("td"), ...FIGURES.map((figure) => (this.cells[`head ${figure.id}`] = el("th",
      { scope: "col", title: figure.about, tabindex: 0 }, figure.label, el("span", { class: "unit" }, ` ${figure.unit}`)))));
    table.append(el("thead", {}, top), el("tbody", {}, row("now", "This design"), row("pinned", "Pinned (A)"), row("change", "Change"),
      row("limit", "Limits"), row("verdict", "Verdict")));
    this.rows = { head: top };
    for (const name of ["now", "pinned", "change", "limit", "verdict"]) this.rows[name] = table.querySelector(`tr.${name}`);
    for (const { id, label } of FIGURES) {
      this.cells[`now ${id}`].dataset.testid = id;
      const inputs = ["least", "most"].map((which, i) => el("input", { type: "number", step: "any", name: `limits.${LIMITS[id] ?? id}.${i}`, placeholder: i ? "most" : "least",
        "aria-label": `${label}: ${which}`, oninput: (event) => this.limit(id, i, event.target.valueAsNumber) }));
      this.cells[`limit ${id}`].append(...inputs);
      this.cells[`limit ${id}`].inputs = inputs;
    }
  }

  limit(id, i, value) {
    this.store.edit((now) => {
      const pair = [...(limitOf(now, id) ?? [null, null])];
      pair[i] = Number.isFinite(value) ? value : null;
      setLimit(now, id, pair);
    });
  }

  // The fields show the limits that there are, whatever was entered.
  inForce() {
    this.typed = null;
    for (const { id } of FIGURES) {
      const pair = limitOf(this.store.now, id);
      this.cells[`limit ${id}`].inputs.forEach((input, i) => { input.value = pair?.[i] ?? ""; });
    }
  }

  // Measures that the page has no column for get one: whoever registers one sees it here.
  extend(measures) {
    for (const { name, title, unit, decimals, definition } of measures) {
      if (this.cells[`now ${name}`]) continue;
      const cell = (row, tag, about = {}, ...words) => this.rows[row].append((this.cells[`${row} ${name}`] = el(tag, about, ...words)));
      cell("head", "th", { scope: "col", title: definition, tabindex: 0 }, title, el("span", { class: "unit" }, ` ${unit}`));
      for (const row of ["now", "pinned", "change", "limit", "verdict"]) cell(row, "td");
      this.cells[`now ${name}`].dataset.testid = name;
      const of = (answer) => answer.measures?.find((one) => one.name === name)?.value ?? null;
      this.more.push({ name, of, show: (value) => fixed(value, decimals) });
    }
  }

  shown(answer, pinned) {
    if (answer) this.answer = answer;
    this.extend(this.answer?.measures ?? []);
    for (const { name, of, show } of this.more) {
      const now = this.answer ? of(this.answer) : null, was = pinned ? of(pinned) : null;
      say(this.cells[`now ${name}`], now === null ? "–" : show(now));
      say(this.cells[`pinned ${name}`], !pinned ? "" : was === null ? "–" : show(was));
      say(this.cells[`change ${name}`], now === null || was === null ? "" : signed(show(now - was)));
    }
    const { look } = this.store.now;
    for (const figure of FIGURES) {
      const { id, of, show, fine } = figure;
      const cell = (name) => this.cells[`${name} ${id}`];
      const there = look.view === "road" ? !OF_THE_PLANE.includes(id) || Boolean(limitOf(this.store.now, id)) : figure.view !== "road";
      for (const name of ["head", "now", "pinned", "change", "limit", "verdict"]) if (cell(name).hidden === there) cell(name).hidden = !there;
      const now = this.answer && of(this.answer), stale = fine && !this.answer?.fine && typeof now !== "number";
      if (fine && !stale) this.last[id] = now;
      const value = stale ? this.last[id] : now;
      const was = pinned ? of(pinned) : null;
      const pair = limitOf(this.store.now, id);
      const text = (v, limits) => (v === null || v === undefined ? "–" : telling(v, limits, show));
      cell("now").dataset.value = value ?? "";
      say(cell("now"), text(value, pair), stale ? "stale" : "");
      say(cell("pinned"), pinned ? text(was) : "");
      const change = typeof value === "number" && typeof was === "number" ? value - was : null;
      say(cell("change"), change === null ? "" : signed(show(change)));
      cell("limit").inputs.forEach((input, i) => {
        const wanted = String(pair?.[i] ?? "");
        if (input !== this.typed && input.value !== wanted) input.value = wanted;
      });
      const failed = pair && (typeof value !== "number" || misses(value, pair));
      say(cell("verdict"), !pair ? "" : failed ? "✗ fail" : "✓ pass", !pair ? "" : failed ? "fail" : "pass");
    }
  }
}
