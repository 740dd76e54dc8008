// What the server takes for the keys of a look: a key and a value in, words for one that it refuses out.

import { between } from "./numbers.js";

const CHOICES = { "look.view": ["picture", "road"], "look.eyes": ["one", "both"] };
const LONGEST_NAME = 64;

export class LookRanges {
  constructor(groups) {
    const controls = groups.flatMap((group) => group.controls).filter(({ key }) => key.startsWith("look."));
    this.controls = new Map(controls.map((control) => [control.key, control]));
  }

  // null where the value is taken.
  refused(key, value) {
    const control = this.controls.get(key);
    if (control?.kind === "number") {
      const { label, least, most, unit } = control;
      return typeof value === "number" && value >= least && value <= most ? null : `${label}: ${between(least, most, unit)}`;
    }
    const choices = CHOICES[key] ?? control?.choices.map(([one]) => one);
    if (choices) return choices.includes(value) ? null : `${control?.label ?? key}: ${choices.join(" or ")}`;
    if (key === "look.own") return typeof value === "string" && value.length <= LONGEST_NAME ? null : `${key}: the name of an uploaded mirror`;
    return `${key}: no such key`;
  }
}
