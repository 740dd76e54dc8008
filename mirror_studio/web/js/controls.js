// An input for every key of the specification: a slider that bears the key as its name, and a number beside it.

import { el } from "./dom.js";
import { bringIn, choose, save } from "./files.js";
import { LookRanges } from "./ranges.js";
import { FLAT, MOST_ROWS } from "./numbers.js";
import { aimInWords } from "./road.js";
import { get, put } from "./state.js";
import { post } from "./wire.js";

const LOOK = /^look\./;

export class Controls {
  // laws: of each what it begins with and which of its keys may be open.
  // fail(problem, kind) says what is wrong, well(kind) that it is no more.
  constructor(groups, laws, store, uploads, { fail, well }) {
    Object.assign(this, { laws, store, uploads, fail, well });
    this.ranges = new LookRanges(groups);
    this.typed = null; // the field in which something is being entered: it is left alone until that is done
    this.rows = [];
    this.groups = []; // those that are there for one view alone
    this.element = el("div", { class: "groups" });
    for (const group of groups) this.element.append(this.group(group));
    this.element.addEventListener("input", ({ target }) => { this.typed = target.type === "range" ? null : target; }, true);
    this.element.addEventListener("change", ({ target }) => { if (target.type !== "range") { this.inForce(); this.refresh(); } });
  }

  // From the next refresh on every field shows the value that there is, whatever was entered.
  inForce() {
    this.typed = null;
    for (const row of this.rows) row.state = null;
  }

  group(group) {
    const body = el("div", { class: "rows" });
    for (const control of group.controls) body.append(this.row(control));
    if (group.section === "horizontal") { this.matchRow(body); this.tableRow(body, "horizontal", "Rx"); }
    if (group.section === "vertical") this.tableRow(body, "vertical", "Ry");
    if (group.section === "outline") this.fileRow(body, "outline", "Outline from DXF or SVG …", "outline.file");
    if (group.section === "scene") this.fileRow(body, "picture", "Picture from a file …", "scene.image");
    const element = el("details", { open: group.open }, el("summary", {}, group.title), body);
    if (group.view) {
      this.groups.push({ view: group.view, element });
      body.append(this.aim = el("output", { id: "aim", "data-testid": "aim" }));
    }
    return element;
  }

  value(key) {
    const { now } = this.store;
    return LOOK.test(key) ? get(now, key) : get(now.spec, key);
  }

  set(control, value) {
    const { key } = control, refused = LOOK.test(key) && value !== undefined && this.ranges.refused(key, value);
    if (refused) { this.fail(new Error(refused), "entry"); return; }
    this.store.edit((now) => {
      if (LOOK.test(key)) { put(now, key, value); return; }
      if (/\.law$/.test(key)) { now.spec[key.split(".")[0]] = this.law(key.split(".")[0], value); return; }
      if (key === "surface.integration") put(now.spec, "surface.step_mm", value === "quadrature" ? undefined : now.spec.surface.step_mm ?? 1);
      if (key === `horizontal.${this.laws[now.spec.horizontal.law]?.open}` && now.spec.horizontal.match) delete now.spec.horizontal.match;
      const at = key.match(/^(.*)\.([01])$/);
      if (at) {
        const list = [...(get(now.spec, at[1]) ?? this.defaults(at[1]))];
        list[at[2]] = value;
        put(now.spec, at[1], list);
      } else put(now.spec, key, value);
    });
  }

  defaults(key) {
    return this.rows.filter((row) => row.control.key.startsWith(`${key}.`)).map((row) => row.control.default);
  }

  // Another law that begins near the one there was.
  law(section, kind) {
    const { answer } = this;
    const old = this.store.now.spec[section];
    const curve = answer?.arrays[`law_${section === "horizontal" ? "x" : "y"}`].data ?? new Float32Array([0.8, 0.8]);
    const radius = (k) => (Math.abs(k) > FLAT ? Math.round(10000 / k) / 10 : 1250);
    let [left, right] = [radius(curve[0]), radius(curve.at(-1))];
    if (left * right < 0) left = right;
    const [x0, x1] = answer?.box_mm ?? [-115, 115];
    const places = [0, 1, 2, 3, 4, 5, 6].map((i) => i / 6);
    const samples = places.map((s) => curve[Math.round(s * (curve.length - 1))]);
    const bent = samples.every((k) => Math.abs(k) > FLAT);
    const near = { $right: right, $left: left, $x: places.map((s) => Math.round(10 * (x0 + s * (x1 - x0))) / 10),
      $radius: bent ? samples.map(radius) : undefined, $curvature: bent ? undefined : samples.map((k) => k / 1000) };
    const law = { law: kind };
    for (const [key, first] of Object.entries(this.laws[kind].start)) {
      if (typeof first !== "string") law[key] = first;
      else if (!(first in near)) law[key] = first.replace(/\$(right|left)/g, (name) => near[name]);
      else if (near[first] !== undefined) law[key] = near[first];
    }
    if (section === "horizontal") {
      law.level_at = old.level_at ?? "centre";
      if (old.span_mm) law.span_mm = old.span_mm;
      const { open } = this.laws[kind];
      if (old.match && open) {
        law.match = old.match;
        law[open] = "match";
      }
    }
    return law;
  }

  row(control) {
    const { key, kind, label, unit, help } = control;
    const id = `c-${key.replaceAll(".", "-")}`;
    const row = { control, id };
    const caption = el("label", { for: id, title: help || undefined }, label);
    const line = el("div", { class: `row ${kind}`, "data-key": key }, caption);
    if (kind === "choice") {
      const named = control.low === null ? key : undefined;
      row.select = el("select", { id: control.low === null ? id : `${id}-choice`, name: named, "aria-label": label, onchange: () => this.chosen(row) },
        ...control.choices.map(([value, words], i) => el("option", { value: String(i) }, words)));
      line.append(row.select);
    }
    if (kind === "text") {
      row.text = el("input", { id, name: key, type: "text", spellcheck: "false", autocomplete: "off",
        onchange: () => this.set(control, row.text.value.trim() === "" && control.optional ? undefined : row.text.value.trim()) });
      line.append(row.text);
    }
    if (control.optional && kind === "number" && !key.endsWith(".1")) {
      row.flag = el("input", { type: "checkbox", "aria-label": `${label}: state it`, onchange: () => this.flagged(row) });
      line.prepend(row.flag);
    }
    if (control.low !== null) this.slider(line, row, label, unit);
    if (key === "surface.spans") {
      row.pair = [0, 1].map((i) => el("input", { type: "number", name: `surface.spans.${i}`, min: 1, max: 400, step: 1, class: "narrow",
        "aria-label": i ? "Spans along y" : "Spans along x", oninput: () => this.spans(row) }));
      line.append(...row.pair);
    }
    row.element = line;
    this.rows.push(row);
    return line;
  }

  slider(line, row, label, unit) {
    const { control, id } = row;
    const { low, high, step, digits } = control;
    row.range = el("input", { id, name: control.key, type: "range", min: low, max: high, step: "any", title: control.help || undefined });
    row.number = el("input", { type: "number", step: "any", "aria-label": unit ? `${label} in ${unit}` : label, autocomplete: "off" });
    // A slider moved by hand stops at round numbers; one that is set by a script or an arrow key has what it is given.
    let dragging = false;
    row.range.addEventListener("pointerdown", () => { dragging = true; });
    addEventListener("pointerup", () => { dragging = false; });
    row.range.addEventListener("input", () => {
      const exact = row.range.valueAsNumber;
      this.set(control, dragging ? round(exact, step) : round(exact, 1e-9));
    });
    const nudge = (event, from) => {
      const up = { ArrowUp: 1, ArrowRight: 1, ArrowDown: -1, ArrowLeft: -1, PageUp: 10, PageDown: -10 }[event.key];
      if (!up || event.ctrlKey || event.metaKey || (from === row.number && /Left|Right/.test(event.key))) return;
      event.preventDefault();
      const size = step * (event.shiftKey ? 10 : event.altKey ? 0.1 : 1);
      const to = round(this.shownValue(row) + up * size, size / 10);
      this.typed = null;
      this.set(control, Math.min(control.most ?? Infinity, Math.max(control.least ?? -Infinity, to)));
    };
    row.range.addEventListener("keydown", (event) => {
      if (event.key === "Home" || event.key === "End") { event.preventDefault(); this.set(control, event.key === "Home" ? low : high); }
      nudge(event, row.range);
    });
    row.number.addEventListener("keydown", (event) => nudge(event, row.number));
    row.number.addEventListener("input", () => {
      if (Number.isFinite(row.number.valueAsNumber)) this.set(control, row.number.valueAsNumber);
    });
    row.digits = digits;
    row.unit = el("span", { class: "unit" }, unit);
    line.append(row.range, row.number, row.unit);
  }

  shownValue(row) {
    const value = this.value(row.control.key);
    if (typeof value === "number") return value;
    const { matched } = this.answer ?? {};
    const solved = matched?.[row.control.key.split(".").at(-1)];
    if (row.control.key.startsWith("horizontal.") && solved !== undefined) return solved;
    if (value === "inf") return row.control.high;
    return row.control.default ?? 0;
  }

  chosen(row) {
    const value = row.control.choices[Number(row.select.value)][0];
    if (value !== "number") { this.set(row.control, value); return; }
    this.set(row.control, row.control.key === "surface.spans" ? [24, 4] : 0);
  }

  spans(row) {
    const pair = row.pair.map((input) => input.valueAsNumber);
    if (pair.every(Number.isInteger)) this.set(row.control, pair);
  }

  flagged(row) {
    const { key } = row.control;
    const pair = key.match(/^(.*)\.0$/);
    const value = !row.flag.checked ? undefined : pair ? this.defaults(pair[1]) : row.control.default;
    this.store.edit((now) => put(now.spec, pair ? pair[1] : key, value));
  }

  // --- rows of their own ---

  matchRow(body) {
    const select = el("select", { id: "c-match", "aria-label": "Solve the open number for", onchange: () => this.store.edit((now) => {
      const law = now.spec.horizontal, { open } = this.laws[law.law];
      const solved = this.answer?.matched?.[open];
      if (select.value === "none") { delete law.match; if (law[open] === "match") law[open] = Math.round(1e4 * (solved ?? 0.5)) / 1e4; } else {
        law.match = select.value === "sphere" ? { sphere_mm: 950 }
          : { h_fov_deg: Math.round(100 * (this.answer?.figures.h_fov_deg.section ?? 44.8)) / 100 };
        law[open] = "match";
      }
    }) }, el("option", { value: "none" }, "nothing"), el("option", { value: "sphere" }, "H-FOV of a sphere"),
    el("option", { value: "angle" }, "an H-FOV"));
    this.match = { select, line: el("div", { class: "row choice" }, el("label", { for: "c-match" }, "Solve for"), select) };
    body.querySelector('[data-key="horizontal.match.sphere_mm"]').before(this.match.line);
  }

  tableRow(body, section, axis) {
    const rows = el("div", { class: "table-rows" });
    const buttons = el("div", { class: "buttons" },
      el("button", { type: "button", onclick: () => this.tableIn(section) }, "Table from CSV …"),
      el("button", { type: "button", onclick: () => this.tableOut(section, axis) }, "CSV"));
    body.append(rows, buttons);
    (this.tables ??= {})[section] = { rows, axis };
  }

  async tableIn(section) {
    const file = await choose(this.uploads.table.endings);
    if (!file) return;
    this.well("upload");
    try {
      const law = await post("/upload/table?ending=.csv", file);
      this.store.edit((now) => {
        const old = now.spec[section];
        now.spec[section] = section === "horizontal" ? { ...law, level_at: old.level_at ?? "centre" } : law;
      });
    } catch (error) { this.fail(error, "upload"); }
  }

  // As it stands where the law has rows; else sampled from the curve.
  tableOut(section, axis) {
    const law = this.store.now.spec[section];
    let header, rows;
    if (law.x_mm) {
      header = `x_mm,${law.radius_mm ? "radius_mm" : "curvature_per_mm"}`;
      rows = law.x_mm.map((x, i) => `${x},${(law.radius_mm ?? law.curvature_per_mm)[i]}`);
    } else {
      const { data } = this.answer.arrays[`law_${axis.at(-1)}`];
      const [x0, x1] = this.answer.box_mm;
      const radii = data.every((k) => Math.abs(k) > FLAT && k * data[0] > 0);
      header = `x_mm,${radii ? "radius_mm" : "curvature_per_mm"}`;
      rows = Array.from(data, (k, i) => `${(x0 + (i / (data.length - 1)) * (x1 - x0)).toFixed(4)},${(radii ? 1000 / k : k / 1000).toPrecision(8)}`);
    }
    save(`${this.store.now.spec.name}-${axis}.csv`, `${header}\n${rows.join("\n")}\n`, "text/csv");
  }

  drawTable(section) {
    const { rows, axis } = this.tables[section];
    const law = this.store.now.spec[section];
    if (!law.x_mm || law.x_mm.length > MOST_ROWS) {
      rows.replaceChildren(...(law.x_mm ? [`${law.x_mm.length} rows: edit them as CSV`] : []));
      rows.shape = null;
      return;
    }
    const column = law.radius_mm ? "radius_mm" : "curvature_per_mm";
    const shape = `${column}${law.x_mm.length}`;
    if (rows.shape !== shape) {
      rows.shape = shape;
      rows.replaceChildren(el("div", { class: "table-head" }, el("span", {}, "x, mm"), el("span", {}, column === "radius_mm" ? `${axis}, mm` : "κ, 1/mm")),
        ...law.x_mm.map((_, i) => el("div", {},
          ...["x_mm", column].map((key) => el("input", { type: "number", step: "any", name: `${section}.${key}.${i}`,
            "aria-label": `${key === "x_mm" ? "x" : axis} of row ${i + 1}`,
            oninput: (event) => Number.isFinite(event.target.valueAsNumber) && this.store.edit((now) => { now.spec[section][key][i] = event.target.valueAsNumber; }) })),
          el("button", { type: "button", title: "Add a row after this one", "aria-label": `Add a row after row ${i + 1}`, onclick: () => this.addRow(section, column, i) }, "+"),
          el("button", { type: "button", title: "Remove this row", "aria-label": `Remove row ${i + 1}`, onclick: () => this.store.edit((now) => {
            const at = now.spec[section];
            if (at.x_mm.length > 2) { at.x_mm.splice(i, 1); at[column].splice(i, 1); }
          }) }, "−"))));
    }
    rows.querySelectorAll("input").forEach((input) => {
      const [, key, i] = input.name.split("."), value = String(law[key][Number(i)]);
      if (input !== this.typed && (input.value !== value || input.validity.badInput)) input.value = value;
    });
  }

  addRow(section, column, i) {
    this.store.edit((now) => {
      const law = now.spec[section];
      const next = i + 1 < law.x_mm.length ? i + 1 : i, before = next === i ? i - 1 : i;
      const mid = (list) => 0.5 * (list[before] + list[next]);
      const x = mid(law.x_mm), value = mid(law[column]);
      law.x_mm.splice(next, 0, x);
      law[column].splice(next, 0, value);
    });
  }

  fileRow(body, kind, words, key) {
    const name = el("span", { class: "file-name" });
    const back = el("button", { type: "button", onclick: () => this.store.edit((now) => {
      if (kind === "outline") now.spec.outline = { ...this.store.presets[this.store.opensOn].outline };
      else now.spec.scene.image = "road";
    }) }, kind === "outline" ? "Own sizes again" : "Built-in road again");
    body.append(el("div", { class: "buttons" }, el("button", { type: "button", onclick: async () => {
      const file = await choose(this.uploads[kind].endings);
      if (!file) return;
      this.well("upload");
      try {
        const brought = await bringIn(kind, file);
        name.textContent = file.name;
        this.store.edit((now) => { if (kind === "outline") now.spec.outline = { file: brought }; else now.spec.scene.image = brought; });
      } catch (error) { this.fail(error, "upload"); }
    } }, words), back, name));
    (this.backs ??= {})[key] = { back, name };
  }

  // --- what is shown ---

  refresh() {
    const { spec } = this.store.now;
    for (const { view, element } of this.groups) element.hidden = view !== this.store.now.look.view;
    const aim = this.answer?.road ? aimInWords(this.answer.road) : "";
    if (this.aim.textContent !== aim) this.aim.textContent = aim;
    for (const row of this.rows) {
      const { control } = row, { key } = control;
      const section = key.split(".")[0];
      const law = spec[section]?.law;
      const match = key.match(/^horizontal\.match\.(.*)/);
      let there = !control.law.length || control.law.includes(law);
      if (match) there = there && spec.horizontal.match?.[match[1]] !== undefined;
      if (section === "outline" && spec.outline.file) there = false;
      if (key === "surface.step_mm") there = spec.surface.integration !== "quadrature";
      if (key === "scene.image") row.text.readOnly = true;
      if (row.element.hidden === there) row.element.hidden = !there;
      if (!there) continue;
      const value = this.value(key);
      // Most rows stay as they are while one is moved.
      const state = `${JSON.stringify(value)} ${value === "match" ? this.shownValue(row) : ""}`;
      if (row.state === state) continue;
      row.state = state;
      if (row.select) {
        let i = control.choices.findIndex(([one]) => one === value);
        if (i < 0) i = control.choices.findIndex(([one]) => one === "number");
        row.select.value = String(i);
      }
      if (row.pair) row.pair.forEach((input, i) => { input.hidden = !Array.isArray(value); if (Array.isArray(value) && input !== this.typed) input.value = value[i]; });
      if (row.text && row.text !== this.typed) row.text.value = value ?? "";
      if (row.flag) row.flag.checked = value !== undefined;
      if (row.range) this.fill(row, value);
    }
    const law = spec.horizontal;
    this.match.line.hidden = !this.laws[law.law]?.open;
    this.match.select.value = !law.match ? "none" : law.match.sphere_mm !== undefined ? "sphere" : "angle";
    for (const section of ["horizontal", "vertical"]) this.drawTable(section);
    const file = { "outline.file": spec.outline.file, "scene.image": spec.scene.image === "road" ? undefined : spec.scene.image };
    for (const [key, { back, name }] of Object.entries(this.backs)) { back.hidden = !file[key]; if (!file[key]) name.textContent = ""; }
  }

  fill(row, value) {
    const { control, range, number } = row;
    const absent = value === undefined || (control.choices.length > 0 && typeof value !== "number");
    const solved = value === "match";
    const shown = this.shownValue(row);
    // The slider reaches as far as the number that was entered.
    if (shown > range.max) range.max = shown;
    if (shown < range.min) range.min = shown;
    if (range.valueAsNumber !== shown) range.value = shown;
    if (range.disabled !== absent) range.disabled = number.disabled = absent;
    if (control.choices.length) range.hidden = number.hidden = row.unit.hidden = absent;
    row.element.classList.toggle("solved", solved);
    range.setAttribute("aria-valuetext", value === "inf" ? "flat" : `${trimmed(shown, row.digits)} ${control.unit}${solved ? ", solved" : ""}`);
    number.placeholder = value === "inf" ? "∞" : "";
    if (number !== this.typed) number.value = value === "inf" ? "" : trimmed(shown, row.digits);
  }
}

const round = (value, step) => {
  const size = Math.max(step, 1e-12);
  const digits = Math.max(0, Math.min(12, Math.ceil(-Math.log10(size)) + 1));
  return Number((Math.round(value / size) * size).toFixed(digits));
};

const trimmed = (value, digits) => (Number.isFinite(value) ? String(Number(value.toFixed(digits))) : "");
