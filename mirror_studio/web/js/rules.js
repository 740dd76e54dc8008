// The panel of a rule of the road: its lines for the design at hand, asked for beside the pictures and seldom enough for them.

import { el, find } from "./dom.js";
import { put } from "./state.js";

const MARKS = { met: "✓", missed: "✗", open: "?" };
const EVERY_MS = 450; // between two questions while a slider moves

export class Rules {
  // rules: those that there are, with their classes.   ask(message): to the server; its number, or 0 without a connection.
  constructor(panel, rules, store, ask) {
    Object.assign(this, { panel, rules, store, ask });
    this.asked = 0; // the question that waits for its answer
    this.again = false; // whether the design has changed since
    this.last = 0;
    this.timer = 0;
    this.kept = []; // lines of a mirror on its vehicle, while the hand has not rested yet
    const choose = () => this.chosen();
    this.rule = el("select", { id: "rule-name", "aria-label": "Rule of the road", onchange: choose },
      ...rules.map(({ name, title }) => el("option", { value: name }, title)));
    this.kind = el("select", { id: "rule-class", "aria-label": "Class of mirror", onchange: choose });
    const number = (key, label, word) => el("input", { type: "number", min: 0, max: 100, step: "any", "data-key": key, "aria-label": label, title: label,
      placeholder: word, oninput: ({ target }) => this.store.edit((now) => put(now.spec, `rules.${key}`, Number.isFinite(target.valueAsNumber) ? target.valueAsNumber : undefined)) });
    this.measured = [number("reflectance_percent", "Reflectance as measured, %", "day"), number("reflectance_night_percent", "Reflectance of the night position, %", "night")];
    this.head = el("p", { class: "edition" });
    this.table = el("table", { "data-testid": "rule-lines" }, el("thead", {}, el("tr", {}, ...["", "value", "limit", "margin", ""].map((word, i) => el("th", { scope: "col", "aria-label": word || (i ? "verdict" : "requirement") }, word)))));
    this.body = el("tbody");
    this.table.append(this.body);
    this.foot = el("p", { class: "edition" });
    panel.append(el("div", { class: "pick" }, this.rule, el("label", { for: "rule-class" }, "class"), this.kind,
      el("span", {}, "reflects, %"), ...this.measured), this.head, el("div", { class: "lines" }, this.table), this.foot);
  }

  get open() { return !this.panel.hidden; }

  // Shown for the first time, it names a rule in the specification.
  toggle(on) {
    this.panel.hidden = !on;
    find("#side").classList.toggle("ruled", on);
    if (!on) return;
    if (!this.store.now.spec.rules) this.store.edit((now) => { now.spec.rules = { rule: this.rules[0].name, class: this.rules[0].start }; });
    this.refresh();
    this.due(true);
  }

  chosen() {
    const of = this.rules.find(({ name }) => name === this.rule.value);
    const kind = of.classes.includes(this.kind.value) ? this.kind.value : of.start;
    this.store.edit((now) => { now.spec.rules = { ...now.spec.rules, rule: of.name, class: kind }; });
    this.refresh();
  }

  // The fields as the specification has them.
  refresh() {
    if (!this.open) return;
    const held = this.store.now.spec.rules ?? {};
    const of = this.rules.find(({ name }) => name.toLowerCase() === (held.rule ?? "").toLowerCase()) ?? this.rules[0];
    this.rule.value = of.name;
    if (this.kind.dataset.of !== of.name) {
      this.kind.dataset.of = of.name;
      this.kind.replaceChildren(...of.classes.map((name) => el("option", { value: name }, name)));
    }
    this.kind.value = held.class ?? of.start;
    for (const input of this.measured) {
      const value = held[input.dataset.key];
      if (document.activeElement !== input) input.value = value ?? "";
    }
  }

  // A design was shown: its lines are asked for, unless that was just done. fine: the hand rests.
  due(fine) {
    if (!this.open || !this.store.now.spec.rules) return;
    this.fine = fine;
    if (this.asked) { this.again = true; return; }
    clearTimeout(this.timer);
    const left = fine ? 0 : this.last + EVERY_MS - performance.now();
    if (left > 0) { this.timer = setTimeout(() => this.due(this.fine), left); return; }
    this.again = false;
    this.asked = this.ask({ type: "rules", fine: Boolean(fine) });
  }

  answered(message) {
    if (message.id !== this.asked) return;
    this.asked = 0;
    this.last = performance.now();
    if (message.faults) this.fault(message.faults);
    else this.show(message);
    if (this.again) this.due(this.fine);
  }

  lost() { this.asked = 0; }

  fault(faults) {
    this.head.textContent = faults.join("\n");
    this.body.replaceChildren();
    this.foot.textContent = "";
  }

  show({ lines, rule, edition, vehicle, pending, wording }) {
    if (!rule) return;
    if (vehicle) this.kept = lines.filter(({ quantity }) => /^(field_|mirror_)/.test(quantity));
    const all = pending ? [...lines, ...this.kept.map((line) => ({ ...line, stale: true }))] : lines;
    if (!pending && !vehicle) this.kept = [];
    const count = (verdict) => all.filter((line) => line.verdict === verdict).length;
    this.head.textContent = `${rule}, ${edition}: ${count("missed")} missed, ${count("open")} open, ${count("met")} met`;
    this.foot.textContent = `${vehicle || pending ? "" : "Fields of vision: in the view Road. "}The official text decides. ${wording}`;
    this.foot.title = wording;
    const shape = all.map(({ paragraph, text }) => paragraph + text).join("\n");
    if (this.body.dataset.shape !== shape) {
      this.body.dataset.shape = shape;
      this.body.replaceChildren(...all.map(({ paragraph, text, checked }) => el("tr", {}, el("th", { scope: "row" }, el("span", { class: "paragraph" }, paragraph), ` ${text}`,
        checked === "read" ? null : el("span", { class: "checked" }, checked)), el("td"), el("td"), el("td", { class: "margin" }), el("td", { class: "mark" }))));
    }
    all.forEach((line, i) => {
      const row = this.body.rows[i], words = [line.value === "—" && line.notes[0] === "flat" ? "flat" : line.unit && line.value !== "—" ? `${line.value} ${line.unit}` : line.value, line.limit, line.margin];
      row.className = `${line.verdict}${line.stale ? " stale" : ""}`;
      row.title = [line.verdict, ...line.notes, line.measured].join("\n");
      words.push(MARKS[line.verdict]);
      words.forEach((text, k) => { if (row.cells[k + 1].textContent !== text) row.cells[k + 1].textContent = text; });
      row.dataset.quantity = line.quantity;
      row.dataset.verdict = line.verdict;
    });
  }
}
