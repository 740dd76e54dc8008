// The design with its history: keys in, changed copies out; to the address and back.

const MOST_HISTORY = 200;
const SETTLE_MS = 350; // changes closer than this are one step of undo

// Limits of these figures are the specification's own, which the files are judged by; those of others are the page's.
export const LIMITS = { "h-fov": "h_fov_deg", "v-fov": "v_fov_left_deg", straightness: "lane_straightness_percent" };
export function limitOf({ spec, limits }, id) {
  return id in LIMITS ? spec.limits?.[LIMITS[id]] : limits[id];
}
export function setLimit(state, id, pair) {
  const home = id in LIMITS ? (state.spec.limits ??= {}) : state.limits, key = LIMITS[id] ?? id;
  if (pair.every((one) => one === null)) delete home[key];
  else home[key] = pair;
}

export const copy = (value) => JSON.parse(JSON.stringify(value));

export function get(object, key) {
  return key.split(".").reduce((at, part) => (at === undefined || at === null ? undefined : at[part]), object);
}

export function put(object, key, value) {
  const parts = key.split(".");
  const last = parts.pop();
  let at = object;
  for (const part of parts) at = at[part] ??= {};
  if (value === undefined) delete at[last];
  else at[last] = value;
}

// {a: {b: 1}} → {"a.b": 1}; lists are values.
export function flat(object, prefix = "", into = {}) {
  for (const [key, value] of Object.entries(object)) {
    if (value !== null && typeof value === "object" && !Array.isArray(value)) flat(value, `${prefix}${key}.`, into);
    else into[`${prefix}${key}`] = value;
  }
  return into;
}

export class Store {
  // changed(now, settled, replaced): settled: no step by hand; replaced: every value may be another one.
  constructor(presets, look, opensOn, changed) {
    this.presets = presets;
    this.look = look; // how a design is looked at to begin with
    this.opensOn = opensOn;
    this.changed = changed;
    this.past = [];
    this.future = [];
    this.now = this.fresh(opensOn);
    this.base = JSON.stringify(this.now);
    this.timer = 0;
  }

  fresh(preset) {
    return { preset, spec: copy(this.presets[preset]), look: { ...this.look }, limits: {} };
  }

  // One change by hand. It becomes a step of undo when the hand rests.
  edit(change) {
    change(this.now);
    this.unsettled = true;
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.settle(), SETTLE_MS);
    this.changed(this.now);
  }

  settle() {
    clearTimeout(this.timer);
    this.unsettled = false;
    const text = JSON.stringify(this.now);
    if (text === this.base) return;
    this.past.push(this.base);
    if (this.past.length > MOST_HISTORY) this.past.shift();
    this.future = [];
    this.base = text;
    this.toAddress();
    this.changed(this.now, true);
  }

  replace(state) {
    this.settle();
    this.now = state;
    this.settle();
    this.changed(this.now, false, true);
  }

  undo() {
    this.settle();
    if (this.past.length) this.travel(this.past, this.future);
  }

  redo() {
    this.settle();
    if (this.future.length) this.travel(this.future, this.past);
  }

  travel(from, to) {
    to.push(this.base);
    this.base = from.pop();
    this.now = JSON.parse(this.base);
    this.toAddress();
    this.changed(this.now, true, true);
  }

  // Whether the specification is no longer its preset's; what it must meet is no part of that.
  get different() {
    const [own, preset] = [this.now.spec, this.presets[this.now.preset]].map(({ limits, rules, ...rest }) => flat(rest));
    return differing(own, preset).length > 0;
  }

  // --- the address: the preset, then every key that differs from it ---

  // An address that was put there and is yet to be read, as a link that is pasted just after a change, stays.
  toAddress() {
    if (location.hash.length > 1 && location.hash !== this.address) return;
    const parts = [this.now.preset];
    const { spec, look, limits } = this.now;
    const own = flat({ ...spec, look, limits: { ...spec.limits, ...limits } });
    const preset = flat({ ...this.presets[this.now.preset], look: this.look });
    for (const key of differing(own, preset)) parts.push(`${key}=${key in own ? encode(own[key]) : ""}`);
    history.replaceState(null, "", `#${parts.join("&")}`);
    this.address = location.hash;
  }

  // Raises nothing: what cannot be read is left out, as is what `refused` has words for, which are returned; the server says
  // what is wrong with the rest. null: the address holds no design.   later: the page has a design, which undo brings back.
  fromAddress(refused, later = false) {
    this.address = location.hash; // as it was last written or read
    const [preset, ...parts] = location.hash.slice(1).split("&");
    if (!preset) return null;
    const left = [];
    const state = this.fresh(preset in this.presets ? preset : this.opensOn);
    for (const part of parts) {
      const cut = part.indexOf("=");
      if (cut < 1) continue;
      const key = part.slice(0, cut);
      if (!/^[A-Za-z0-9_.-]+$/.test(key) || /(^|\.)(__proto__|constructor|prototype)(\.|$)/.test(key)) continue;
      const value = decode(part.slice(cut + 1));
      const words = /^look(\.|$)/.test(key) && value !== undefined && refused(key, value);
      if (words) { left.push(words); continue; }
      const home = /^look\.|^limits\.[^_]+$/.test(key) ? state : state.spec; // the specification's limits name their unit
      put(home, key, value);
    }
    if (!state.spec.horizontal.match || !Object.keys(state.spec.horizontal.match).length) delete state.spec.horizontal.match;
    if (later) this.replace(state);
    else {
      this.now = state;
      this.base = JSON.stringify(state);
      this.changed(this.now, true, true);
    }
    return left;
  }
}

// Keys whose values are not the same in both.
const differing = (own, preset) => [...Object.keys(own).filter((key) => JSON.stringify(own[key]) !== JSON.stringify(preset[key])),
  ...Object.keys(preset).filter((key) => !(key in own))];

const encode = (value) => (typeof value === "string" && !/^[-+0-9.[{"tfn]/.test(value) ? encodeURIComponent(value)
  : encodeURIComponent(JSON.stringify(value)).replaceAll("%2C", ",").replaceAll("%5B", "[").replaceAll("%5D", "]"));

function decode(text) {
  if (text === "") return undefined;
  try {
    const plain = decodeURIComponent(text);
    try { return JSON.parse(plain); } catch { return plain; }
  } catch { return undefined; }
}
