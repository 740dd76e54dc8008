// A made mirror laid on the design at hand: its figures, verdict and measures in a panel, its deviations as maps.

import { QUANTITIES } from "./colours.js";
import { el, find } from "./dom.js";
import { bringIn, save } from "./files.js";
import { fixed } from "./numbers.js";

const COVERAGE = 1.959963984540054; // sigmas to either side that hold 95 %
const VERDICTS = { pass: ["✓ pass", "pass"], fail: ["✗ fail", "fail"], undecided: ["? undecided", "open"] };
const ROWS = [["height", "Height", "µm", 1000, 1, "mm"], ["slope", "Slope", "′", 1, 2, "arcmin"], ["k1", "k₁"], ["k2", "k₂"], ["kx", "kx"], ["ky", "ky"], ["twist", "Twist"]];
const ALIGN = [["best-fit", "best fit"], ["none", "as measured"], ["321", "3-2-1"]]; // the first is what there is at first

// The cell of the maps that a place of the mirror lies in: the nearest one beyond their edges.
export function cellAt({ cells_mm: [x0, x1, y0, y1], arrays: { measured_stands: { shape: [nx, ny] } } }, x, y) {
  const k = (v, low, high, n) => Math.max(0, Math.min(n - 1, Math.floor(((v - low) / (high - low)) * n)));
  return k(x, x0, x1, nx) * ny + k(y, y0, y1, ny);
}

const field = (label, unit, scale, name, times = 1, digits = 2) => ({ label, unit, scale, cells: true, digits, sigma: `measured_${name}_sigma`, times,
  of: (arrays) => (times === 1 ? arrays[`measured_${name}`].data : arrays[`measured_${name}`].data.map((v) => times * v)), tick: (v) => fixed(v, digits) });
const SIGMA = /_sigma$/;

export class Measured {
  // ask(message): to the server; its number, or 0 without a connection.   shown(): there is another mirror, or none any more.
  // choose(quantity): colour the mirror by this one.
  constructor(panel, store, endings, { ask, shown, choose, fail, well }) {
    Object.assign(this, { panel, store, endings, ask, shown, choose, fail, well });
    this.asked = 0;
    this.files = []; // {name on the server, title}
    this.badge = el("b", { class: "badge none", "data-testid": "measured-verdict" }, "Measured");
    this.title = el("span", { class: "title" });
    this.step = el("span", { role: "status", class: "step" });
    this.stop = el("button", { type: "button", onclick: () => this.ask({ type: "cancel", what: "inspect" }) }, "Cancel");
    this.again = el("button", { type: "button", hidden: true, title: "The design is no longer the one that the data were laid on", onclick: () => this.compare() }, "Compare again");
    this.beside = el("button", { type: "button", title: "The picture and the road in the measured mirror, beside the design's", onclick: () => this.toggleBeside() }, "Beside");
    this.align = el("select", { "aria-label": "How the points are laid on the design", onchange: () => this.compare() },
      ...ALIGN.map(([value, words]) => el("option", { value }, words)));
    this.sigma = el("input", { type: "number", min: 0, step: "any", class: "narrow", placeholder: "own", "aria-label": "Standard uncertainty of a point in µm; from the points' own scatter without it", title: "σ of a point, µm; from the points' own scatter without it", onchange: () => this.compare() });
    this.ofSigma = el("label", {}, "σ, µm ", this.sigma);
    const take = (kind, words, title) => el("button", { type: "button", title, "data-testid": `measured-${kind}`, onclick: () => this.take(kind) }, words);
    this.body = el("div", { class: "body" });
    panel.append(el("div", { class: "head" }, this.badge, el("span", { class: "push" }), take("measured", "STEP", "The measured surface"), take("inspection", "JSON", "inspection.json: all figures with their sigmas"),
      take("maps", "Maps", "All fields as CSV"), take("report", "Report", "The report of the inspection"), el("button", { type: "button", "aria-label": "Put the measured mirror away", title: "Put it away", onclick: () => this.away() }, "×")),
    el("div", { class: "head" }, this.beside, this.align, this.ofSigma, this.again, this.title, this.step, this.stop), this.body);
    this.say("");
  }

  get open() { return !this.panel.hidden; }

  // Files are brought in and laid on the design.
  async bring(files) {
    this.well("measured");
    this.say("bringing in …");
    this.panel.hidden = false;
    try {
      const found = [];
      for (const file of files) found.push({ name: await bringIn("measured", file), title: file.name });
      this.files = found;
      this.compare();
    } catch (problem) {
      this.say("");
      if (!this.found) this.panel.hidden = true;
      this.fail(problem, "measured");
    }
    this.shown();
  }

  compare() {
    if (!this.files.length) return;
    const { spec, look } = this.store.now, micrometres = this.sigma.valueAsNumber;
    this.well("measured");
    this.asked = this.ask({ type: "inspect", spec, look: { ...look, width: 640, height: 480 }, data: this.files.map(({ name }) => name), align: this.align.value,
      ...(Number.isFinite(micrometres) ? { sigma_mm: micrometres / 1000 } : {}) });
    if (!this.asked) { this.fail(new Error("the studio's server does not answer: the points can be compared when it does"), "measured"); return; }
    this.of = keyOf(spec);
    this.say("starting");
  }

  away() {
    if (this.asked) this.ask({ type: "cancel", what: "inspect" });
    this.asked = 0;
    this.files = [];
    const { own } = this.found ?? {};
    this.found = null;
    this.panel.hidden = true;
    this.well("measured");
    for (const quantity of Object.keys(QUANTITIES)) if (quantity.startsWith("measured_")) delete QUANTITIES[quantity];
    if (own && this.store.now.look.own === own) this.store.edit(({ look }) => { delete look.own; });
    this.shown();
  }

  say(step) {
    this.step.textContent = this.step.title = step;
    this.step.hidden = this.stop.hidden = !step;
    for (const one of [this.title, this.beside, this.align, this.ofSigma]) one.hidden = Boolean(step);
    if (step) this.again.hidden = true;
  }

  // --- what the server says ---

  inspecting({ id, step }) { if (id === this.asked) this.say(step); }

  uninspected({ id, faults }) {
    if (id !== this.asked) return;
    this.asked = 0;
    this.say("");
    if (!this.found) this.panel.hidden = true;
    if (faults.length) this.fail(Object.assign(new Error(faults.join("\n")), { faults }), "measured");
    this.shown();
  }

  inspected(message) {
    if (message.id !== this.asked) return;
    this.asked = 0;
    this.say("");
    const before = this.found?.own;
    this.found = message;
    for (const [name, array] of Object.entries(message.arrays)) { delete message.arrays[name]; message.arrays[`measured_${name}`] = array; }
    this.offer();
    this.draw();
    const { own } = message, { look } = this.store.now;
    if (own ? look.own !== own : look.own && look.own === before) this.store.edit((now) => { if (own) now.look.own = own; else delete now.look.own; });
    this.shown();
    this.choose("measured_k1");
  }

  lost() {
    if (this.asked) this.fail(new Error("the connection ended while the points were being compared: compare them again"), "measured");
    this.asked = 0;
    this.say("");
  }

  // What the mirror can be coloured by.
  offer() {
    const unit = this.found.unit === "percent" ? "%" : "1/m", digits = unit === "%" ? 2 : 4, { arrays } = this.found;
    const made = (label, unit_, name, times, digits_) => {
      QUANTITIES[`measured_${name}`] = field(`Measured Δ${label}`, unit_, "diverging", name, times, digits_);
      QUANTITIES[`measured_${name}_sigma`] = field(`σ of Δ${label}`, unit_, "sequential", `${name}_sigma`, times, digits_);
    };
    // From 0 up: an angle has no sign.
    const angle = (label, name) => {
      QUANTITIES[`measured_${name}`] = { ...field(label, "′", "sequential", name), sigma: `measured_${name.replace("_arcmin", "")}_sigma_arcmin` };
      QUANTITIES[`measured_${name}_sigma`] = field(`σ of ${label.replace("Measured ", "")}`, "′", "sequential", name.replace("_arcmin", "_sigma_arcmin"));
    };
    QUANTITIES.measured_height_mm = { ...field("Measured Δheight", "µm", "diverging", "height_mm", 1000, 1), sigma: "measured_height_sigma_mm" };
    QUANTITIES.measured_height_mm_sigma = field("σ of Δheight", "µm", "sequential", "height_sigma_mm", 1000, 2);
    angle("Measured slope", "slope_arcmin");
    if (arrays.measured_ray_turn_arcmin) angle("Measured turn of the ray", "ray_turn_arcmin");
    for (const [name, label] of ROWS.slice(2)) made(label, unit, name, 1, digits);
  }

  // --- the panel ---

  draw() {
    const { inspection, measures, missed } = this.found, { points, verdict, verdict_basis: basis } = inspection;
    const [words, kind] = VERDICTS[verdict] ?? ["no limit", "none"];
    this.badge.textContent = words;
    this.badge.className = `badge ${kind}`;
    this.badge.title = basis ? `Limit ${basis.limit_percent} % of curvature; at 95 %: surely ${text(basis.surely_percent, 2)} %, possibly ${text(basis.possibly_percent, 2)} %. ${missed.join("; ")}` : "Part's limit, under Surface and limits, sets one";
    const left = points.left_out ? `, ${points.left_out} left out (${Object.entries(points.left_out_because).map(([why, n]) => `${n} ${why}`).join(", ")})` : "";
    this.title.textContent = this.files.map(({ title }) => title).join(", ");
    this.title.title = this.title.textContent;
    const about = `${points.used} points${left} · σ ${text(inspection.sigma_mm === null ? null : 1000 * inspection.sigma_mm, 1)} µm ${inspection.sigma_from === "stated" ? "stated" : "of residuals"} · gauge ${fixed(inspection.gauge_mm, 0)} mm`;
    const flat = this.found.unit === "per_m";
    const rows = ROWS.map(([name, label, unit = flat ? "1/m" : "%", times = 1, digits = flat ? 4 : 2, key = flat ? "per_m" : "percent"]) => {
      const one = inspection[name], of = (v) => text(v === null || v === undefined ? null : times * v, digits);
      const sure = one[`max_sigma_${key}`] ?? (flat ? one.sigma_per_m : null);
      return el("tr", { "data-quantity": name }, el("th", { scope: "row" }, el("button", { type: "button", class: "plain", title: "Colour the mirror by it", onclick: () => this.choose(`measured_${{ height: "height_mm", slope: "slope_arcmin" }[name] ?? name}`) }, `${label} `, el("span", { class: "unit" }, unit))),
        el("td", { title: one.max_at_mm ? `at (${one.max_at_mm.map((v) => fixed(v, 1)).join(", ")}) mm` : "not known" }, of(one[`max_${key}`]), sure === null || sure === undefined ? "" : el("span", { class: "unit" }, ` ± ${of(COVERAGE * sure)}`)),
        el("td", {}, of(one[`rms_${key}`])), el("td", {}, of(one[`sigma_${key}`])));
    });
    const seen = measures.map(({ name, title, unit, decimals, designed, measured, sigma }) => el("tr", { "data-measure": name }, el("th", { scope: "row" }, `${title} `, el("span", { class: "unit" }, unit)),
      el("td", {}, text(designed, decimals)), el("td", {}, text(measured, decimals), sigma === null ? "" : el("span", { class: "unit" }, ` ± ${text(COVERAGE * sigma, decimals)}`))));
    const head = (...titles) => el("thead", {}, el("tr", {}, ...titles.map((title) => el("th", { scope: "col" }, title))));
    this.body.replaceChildren(el("p", { class: "unit" }, about),
      el("table", { "data-testid": "measured-figures" }, head("measured − designed", "largest, 95 %", "RMS", "σ"), el("tbody", {}, ...rows)),
      ...(seen.length ? [el("table", { class: "seen" }, head("as the driver sees it", "designed", "measured, 95 %"), el("tbody", {}, ...seen))] : []),
      ...inspection.notes.map((note) => el("p", { class: "warning" }, note)));
    this.beside.disabled = !this.found.own;
    this.refresh();
  }

  refresh() {
    if (!this.found) { this.beside.disabled = true; return; }
    const stale = keyOf(this.store.now.spec) !== this.of;
    this.panel.classList.toggle("stale", stale && !this.asked);
    this.again.hidden = !stale || Boolean(this.asked);
    this.beside.setAttribute("aria-pressed", String(Boolean(this.found.own) && this.store.now.look.own === this.found.own));
  }

  toggleBeside() {
    const { own } = this.found;
    this.store.edit(({ look }) => { if (look.own === own) delete look.own; else look.own = own; });
  }

  async take(kind) {
    if (!this.found) return;
    this.well("measured");
    const path = `/files/${this.found.token}/${kind}`;
    const there = await fetch(path, { method: "HEAD" }).catch(() => null);
    if (there?.ok) save("", path);
    else this.fail(new Error("the files are no longer on the server: compare again"), "measured");
  }

  // --- under the pointer ---

  // The maps beside an answer's own.
  onto(answer) {
    if (!this.found) return;
    Object.assign(answer.arrays, this.found.arrays);
    answer.cells_mm = this.found.cells_mm;
  }

  // A quantity's value at a place of the mirror, with what holds 95 %.
  at(quantity, [x, y]) {
    const one = QUANTITIES[quantity];
    if (!one?.cells || !this.found) return "";
    const k = cellAt(this.found, x, y), value = this.found.arrays[quantity.replace(SIGMA, "")] && one.of(this.found.arrays)[k];
    const sigma = SIGMA.test(quantity) ? undefined : this.found.arrays[one.sigma]?.data[k];
    if (!Number.isFinite(value)) return "not known here";
    return `${fixed(value, one.digits)}${Number.isFinite(sigma) ? ` ± ${fixed(COVERAGE * one.times * sigma, one.digits)}` : ""} ${one.unit}`;
  }
}

// What of a specification the measured mirror is compared with.
const keyOf = ({ name, horizontal, vertical, outline, blank, surface, target, glass, part, limits }) => JSON.stringify([name, horizontal, vertical, outline, blank, surface, target, glass, part, limits?.curvature_percent ?? null]);

const text = (value, digits) => (value === null || value === undefined ? "–" : fixed(value, digits));
