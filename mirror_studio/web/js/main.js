// The page: the parts made and wired to each other.

import { Controls } from "./controls.js";
import { css, QUANTITIES, coloured } from "./colours.js";
import { el, find } from "./dom.js";
import { bringAgain, bringIn, choose, chooseSome, dropZones, save } from "./files.js";
import { Figures } from "./figures.js";
import { Front, ofFront } from "./front.js";
import { ViewGrid } from "./grid.js";
import { LawPlot } from "./laws.js";
import { FlatMap, Plan } from "./maps.js";
import { Measured } from "./measured.js";
import { Mirror3D } from "./mirror3d.js";
import { pictureOf, Road } from "./road.js";
import { Rules } from "./rules.js";
import { Stage } from "./stage.js";
import { copy, LIMITS, limitOf, setLimit, Store } from "./state.js";
import { Faults, post, postForFile, SILENT, Wire } from "./wire.js";

const REST_MS = 160; // a hand that has not moved for so long rests: the fine picture is due

const start = await (await fetch("/start")).json();
let answer = null, wire = null, pinned = null, restTimer = 0, quantity = "rx", changedAt = 0, built = null;
const rates = [];
const made = find("#made");
let madeOf = ""; // the design for which it says something

// --- errors, in words ---

// By what they are about: "design", "entry" (a value that was not taken), "link", "upload", "pin", "files".
const error = find("#error"), wrong = new Map();
function fail(problem, kind) {
  wrong.set(kind, (problem instanceof Faults ? problem.faults : [problem.message ?? String(problem)]).join("\n"));
  say();
}
function well(kind) { if (wrong.delete(kind)) say(); }
function say() {
  const text = [...wrong.values()].join("\n");
  if (error.textContent !== text) error.textContent = text;
  error.parentElement.hidden = !text;
}
find("#error-close").addEventListener("click", () => { wrong.clear(); say(); });

// --- the parts ---

const store = new Store(start.presets, start.look, start.opens_on, changed);
const laws = [new LawPlot("horizontal", "Rx", store, start.laws), new LawPlot("vertical", "Ry", store, start.laws)];
find("#laws").append(...laws.map((law) => law.element));
const controls = new Controls(start.controls, start.laws, store, start.uploads, { fail, well });
find("#controls").append(controls.element);
const stage = new Stage(find("#driver-view"), find("#readout"), {
  probe: (at) => wire.ask({ type: "probe", ...at }),
  due: () => wire.flying.size > 0,
  presented({ fine, flight }) {
    beside(fine);
    if (fine) setTimeout(() => requestAnimationFrame(done)); // after what `paint` draws
    else if (flight) measure(flight);
  },
});
stage.resized = () => rest();
const viewGrid = new ViewGrid(store, stage, { fail, well });
find("#controls").append(viewGrid.element);
const flat = new FlatMap(find("#flat-map")), plan = new Plan(find("#plan")), solid = new Mirror3D(find("#mirror-3d"));
solid.busy = () => wire.flying.size > 0 || performance.now() - changedAt < 120;
const figures = new Figures(find("#figures"), store);
const road = new Road(store, () => repin());
const rules = new Rules(find("#rule-panel"), start.rules, store, (message) => wire.ask(message));

const measured = new Measured(find("#measured-panel"), store, start.uploads.measured.endings, { fail, well, ask: (message) => wire.ask(message), shown: measuredShown, choose: colourBy });

stage.ownWords = () => (measured.found?.own && measured.found.own === store.now.look.own ? "as measured" : "your mirror");

const select = find("#quantity");
select.addEventListener("change", () => colourBy(select.value));
function colourBy(one) {
  quantity = one;
  if (select.value !== one) select.value = one;
  colour();
}
function offered() {
  select.replaceChildren(...Object.entries(QUANTITIES).map(([key, { label, unit }]) => el("option", { value: key }, `${label}, ${unit}`)));
  if (!(quantity in QUANTITIES)) quantity = "rx";
  select.value = quantity;
}
offered();
// Another measured mirror, or none any more.
function measuredShown() {
  const { classList } = find("#side");
  if (measured.open && !classList.contains("measured")) { showFront(false); showRules(false); }
  classList.toggle("measured", measured.open);
  if (answer) measured.onto(answer);
  offered();
  colour();
  measured.refresh();
}
find("#flat-map").addEventListener("pointermove", ({ offsetX, offsetY }) => { if (flat.toMirror) mapCaption(measured.at(quantity, flat.toMirror(offsetX, offsetY))); });
find("#flat-map").addEventListener("pointerleave", () => mapCaption(""));
const mapCaption = (words) => { find("#map-caption").textContent = words || "Map"; };
function colour() {
  if (!answer) return;
  flat.show(answer, quantity);
  solid.show(answer, quantity);
  legend();
}
function legend() {
  const { low, high, flat: one } = coloured(quantity, answer.arrays), { scale, tick, unit } = QUANTITIES[quantity];
  find("#scale").style.background = css(scale);
  const text = `${scale}${low}${high}${one}`;
  if (find("#ticks").dataset.of === text) return;
  find("#ticks").dataset.of = text;
  const ticks = one ? ["", tick(0.5 * (low + high)), ""] : [low, 0.5 * (low + high), high].map(tick);
  find("#ticks").replaceChildren(...ticks.map((text) => el("span", {}, text)));
  find("#scale").title = unit;
}

function toggle(id, act, on = false) {
  const button = find(id);
  const set = (value) => { button.setAttribute("aria-pressed", String(value)); act(value); };
  button.addEventListener("click", () => set(button.getAttribute("aria-pressed") !== "true"));
  button.setAttribute("aria-pressed", String(on));
  return set;
}
toggle("#grid", (on) => { stage.grid = on; stage.draw(); });
toggle("#reflection-lines", (on) => { solid.lines = on; solid.later(); });
// One panel takes the side's place at a time.
const showRules = toggle("#rules", (on) => { if (on && front.front) showFront(false); rules.toggle(on); });
const front = new Front(find("#front-panel"), store, { fail, well, shown: () => { find("#front").hidden = !front.front; showFront(Boolean(front.front)); } });
const showFront = toggle("#front", (on) => {
  if (on) showRules(false);
  find("#front-panel").hidden = !on;
  find("#side").classList.toggle("fronted", on);
  front.draw();
});
toggle("#combs", (on) => { solid.combs = on; solid.later(); }, true);
find("#eyes").addEventListener("click", () => store.edit(({ look }) => { look.eyes = look.eyes === "both" ? "one" : "both"; }));

// --- requests ---

function request(fine) {
  asked = wanted();
  const { spec, look } = store.now;
  wire?.design({ spec, look: { ...look, ...stage.room(look) }, fine, changed: changedAt });
  stage.expect();
}

function changed(now, settled = false, replaced = false) {
  if (!settled || replaced) well("entry");
  if (replaced) { // the fields show what there is now, whatever was being entered
    controls.inForce();
    figures.inForce();
  }
  if (made.textContent && madeOf !== filesKey()) made.textContent = "";
  paint();
  if (settled && !stale()) return;
  changedAt = performance.now();
  document.body.dataset.due = "yes"; // until the fine picture of this design is on the screen, or it is refused
  request(false);
  rest();
}
function done() {
  if (wire.flying.size === 0 && !wire.next) document.body.dataset.due = "no";
}

// Everything but the driver's view is drawn when a picture is on the screen, or when none comes for a while: on a machine without
// a graphics card each drawing takes the time that the next picture needs. So it is not drawn beside each picture while a hand
// drags, and what is to be had from the plan can wait longer.
const ANSWER_MS = 120, PLAN_MS = 200, BESIDE_MS = 100;
let fresh = null, waiting = 0, planned = 0, drawnBeside = -Infinity, besideTimer = 0;
function beside(fine) {
  clearTimeout(besideTimer);
  const left = fine ? 0 : drawnBeside + BESIDE_MS - performance.now();
  if (left > 0) { besideTimer = setTimeout(beside, left); return; }
  drawnBeside = performance.now();
  figures.shown(answer, pinned?.answer); // in the picture's frame: who waits for that finds them
  paint(true);
}
function paint(soon) {
  if (waiting && !soon) return;
  clearTimeout(waiting);
  waiting = setTimeout(() => requestAnimationFrame(() => {
    waiting = 0;
    const { now } = store, message = fresh;
    fresh = null;
    if (message) {
      if (message.fine || performance.now() - planned > PLAN_MS) {
        planned = performance.now();
        plan.show(message, now.spec.scene.lane, pinned);
      }
      colour();
      notes(message);
    }
    controls.refresh();
    rules.refresh();
    measured.refresh();
    front.refresh();
    viewGrid.refresh();
    find("#laws").classList.toggle("idle", now.spec.surface.method === "view");
    laws.forEach((law) => law.draw());
    figures.shown(null, pinned?.answer);
    road.refresh(now, pinned);
    showPreset(now);
    find("#eyes").setAttribute("aria-pressed", String(now.look.eyes === "both"));
    find("#own-away").hidden = !now.look.own;
    find("#undo").disabled = !store.past.length && !store.unsettled;
    find("#redo").disabled = !store.future.length;
  }), soon ? 0 : ANSWER_MS);
}
// Whether the design that there is now has not been asked for.
let asked = "";
const wanted = () => JSON.stringify([store.now.spec, store.now.look]);
const stale = () => wanted() !== asked;
function rest() {
  clearTimeout(restTimer);
  // A draft of the road that is under way is seen before the hand counts as at rest.
  const due = () => (store.now.look.view === "road" && wire.flying.size > 0 ? rest() : request(true));
  restTimer = setTimeout(due, REST_MS);
}

wire = new Wire({
  async connected() {
    find("#lost").hidden = true;
    for (const [kind, text] of wrong) if (text.startsWith(SILENT)) well(kind);
    const { spec, look } = store.now;
    await bringAgain([spec.outline.file, spec.scene.image, look.own, ...measured.files.map(({ name }) => name)].filter((name) => name && name !== "road"));
    request(false);
    rest();
  },
  lost(reason) {
    find("#lost").textContent = reason ? `Connection closed: ${reason}. Connecting again …` : "The studio's server does not answer. Your work is kept here; connecting again …";
    find("#lost").hidden = false;
    rules.lost();
    measured.lost();
    if (building) {
      endBuild();
      fail(new Error("the connection ended while files were being made: ask for them again"), "files");
    }
  },
  shown(message, flight) {
    if (answer && message.id < answer.id) return;
    measured.onto(message);
    answer = controls.answer = message;
    for (const law of laws) law.answer = message;
    well("design");
    road.shown(message);
    message.flight = flight;
    fresh = message;
    stage.show(message);
    rules.due(message.fine);
  },
  working(message) { if (!answer || message.id > answer.id) road.working(message); },
  // The ground that is seen, before the fine picture is done.
  early(message) {
    if (!answer?.road || message.id < answer.id) return;
    Object.assign(answer.road, message.road);
    Object.assign(answer.arrays, message.arrays);
    figures.shown(answer, pinned?.answer);
    plan.show(answer, store.now.spec.scene.lane, pinned);
  },
  pinned(message) { if (pinned?.asked === message.id) keep(message); },
  unpinned({ id, faults }) { if (pinned?.asked === id) fail(new Faults(faults.map((fault) => `pinned design: ${fault}`)), "pin"); },
  failed(message, flight) {
    fail(new Faults(message.faults), "design");
    road.failed();
    if (flight?.fine) done();
  },
  inspecting(message) { measured.inspecting(message); },
  inspected(message) { measured.inspected(message); },
  uninspected(message) { measured.uninspected(message); },
  ruled(message) { rules.answered(message); },
  unruled(message) { rules.answered(message); },
  probed({ found }) { stage.probed(found); },
  building({ step }) { find("#build-step").textContent = step; progress(step); },
  built(message) { built = { ...message, key: buildKey }; deliver(true); },
  unbuilt({ faults }) { endBuild(); if (faults.length) fail(new Faults(faults), "files"); },
});

function notes({ notes: texts, matched, fit, ms }) {
  const parts = Object.entries(matched).map(([key, value]) => `${key} solved: ${value.toFixed(4)}`);
  parts.push(`${fit.spans.join(" × ")} spans of degree ${fit.degree}${fit.met ? "" : ", tolerance missed"}`, ...texts);
  const text = parts.join(" · ");
  if (find("#notes").textContent !== text) find("#notes").textContent = find("#notes").title = text;
  find("#notes").classList.toggle("warning", !fit.met || texts.length > 0);
  find("#status").title = `design, maps and figures ${ms.design.toFixed(0)} ms, picture ${ms.picture.toFixed(0)} ms`;
}

function measure(flight) {
  const now = performance.now();
  rates.push(now);
  while (now - rates[0] > 1000) rates.shift();
  find("#status").textContent = `${Math.round(now - flight.sent)} ms${rates.length > 4 ? ` · ${rates.length}/s` : ""}`;
}

// --- presets, undo, pin ---

const presets = find("#preset");
const changedPreset = el("option", { value: "", hidden: true }); // shown, and not among those to choose from
presets.append(changedPreset, ...Object.keys(start.presets).map((name) => el("option", { value: name }, name)));
function showPreset({ preset, spec }) {
  const { different } = store, value = different ? "" : preset, words = different ? `${preset}, changed` : "";
  if (changedPreset.textContent !== words) changedPreset.textContent = words;
  if (presets.value !== value) presets.value = value;
  presets.title = different && spec.name === preset ? `The design is no longer ${preset}, but still has its name: another one is given under Files` : "";
}
presets.addEventListener("change", () => {
  const fresh = store.fresh(presets.value);
  for (const id of Object.keys(LIMITS)) setLimit(fresh, id, limitOf(store.now, id) ?? [null, null]);
  store.replace({ ...fresh, limits: store.now.limits, look: { ...store.now.look, yaw_deg: 0, pitch_deg: 0 } });
});
find("#undo").addEventListener("click", () => store.undo());
find("#redo").addEventListener("click", () => store.redo());

async function pin() {
  if (!answer) return;
  well("pin");
  const one = answer, state = copy(store.now); // as they are now: the hand goes on while pictures are decoded
  const fresh = { state, views: {} };
  pinned = Object.assign(fresh, await seen(one));
  if (!one.road || one.fine) fresh.views[viewOf(one)] = await seen(one);
  for (const id of ["#hold", "#swap", "#unpin"]) find(id).disabled = false;
  figures.shown(null, pinned.answer);
  plan.show(answer, store.now.spec.scene.lane, pinned);
  repin();
  paint();
}
const viewOf = (one) => (one.road ? "road" : "picture");
async function seen(one) {
  return { answer: one, names: Object.keys(one.pictures), images: await Promise.all(Object.values(one.pictures).map((picture) => createImageBitmap(picture))),
    ground: Object.entries(one.arrays).filter(([name]) => name.startsWith("ground")).map(([, { data }]) => data) };
}
// The pinned design in the view that there is now: asked for once, as it was when it was pinned.
function repin() {
  if (!pinned) return;
  const { view } = store.now.look, { spec, look } = pinned.state;
  if (pinned.views[view]) { use(pinned.views[view]); return; }
  pinned.asked = wire.ask({ type: "pinned", spec, look: { ...look, view, ...stage.room({ ...look, view }) } });
}
async function keep(message) {
  const one = pinned;
  one.views[viewOf(message)] = await seen(message);
  if (pinned === one && viewOf(message) === store.now.look.view) use(one.views[viewOf(message)]);
}
function use(shown) {
  Object.assign(pinned, shown);
  figures.shown(null, pinned.answer);
  plan.show(answer, store.now.spec.scene.lane, pinned);
  if (hold.getAttribute("aria-pressed") === "true") stage.overlay(pinned);
}
find("#pin").addEventListener("click", pin);
find("#unpin").addEventListener("click", () => {
  pinned = null;
  well("pin");
  stage.overlay(null);
  for (const id of ["#hold", "#swap", "#unpin"]) find(id).disabled = true;
  figures.shown(null, null);
  plan.show(answer, store.now.spec.scene.lane, null);
});
find("#swap").addEventListener("click", async () => {
  const { state } = pinned;
  await pin();
  store.replace({ ...state, look: { ...state.look, view: store.now.look.view } });
});
const hold = find("#hold");
const flip = (on) => { hold.setAttribute("aria-pressed", String(on)); stage.overlay(on && pinned ? pinned : null); find("#held").hidden = !on; };
hold.addEventListener("click", () => flip(hold.getAttribute("aria-pressed") !== "true"));

// --- the designer's own mirror ---

find("#own").addEventListener("click", async () => ownMirror(await choose(start.uploads.reflector.endings)));
async function ownMirror(file) {
  if (!file) return;
  well("upload");
  try {
    const name = await bringIn("reflector", file);
    store.edit(({ look }) => { look.own = name; });
  } catch (problem) { fail(problem, "upload"); }
}
find("#own-away").addEventListener("click", () => store.edit(({ look }) => { delete look.own; }));

// --- a made mirror's measured points, and whatever else is dropped on the page ---

find("#measure").addEventListener("click", async () => {
  const files = await chooseSome(start.uploads.measured.endings);
  if (files.length) measured.bring(files);
});
dropZones(find("#drop"), async (zone, files) => {
  const opened = files[0].name.toLowerCase().endsWith(".toml") || (await Promise.all(files.map(ofFront))).some(Boolean);
  if (zone === "open" || opened) openSome(files);
  else if (zone === "own") ownMirror(files[0]);
  else measured.bring(files);
});

// --- specification in and out, and the address ---

find("#open").addEventListener("click", async () => openSome(await chooseSome([...start.uploads.spec.endings, ".csv", ".json"])));
// A specification, or the files of a front.
async function openSome(files) {
  const ofFronts = await Promise.all(files.map(ofFront));
  if (ofFronts.some(Boolean)) front.bring(files);
  else openSpec(files[0]);
}
async function openSpec(file) {
  if (!file) return;
  well("upload");
  try {
    const { spec, look } = await post("/upload/spec?ending=.toml", file);
    store.replace({ ...store.now, spec, limits: {}, look: { ...store.now.look, ...(look ?? { yaw_deg: 0, pitch_deg: 0 }) } });
  } catch (problem) { fail(problem, "upload"); }
}
async function saveSpec() {
  try {
    const { spec, look } = store.now;
    const { name, text, zip } = await post("/toml", JSON.stringify({ spec, look: { ...look, ...stage.room(look) } }));
    if (zip) save(name, Uint8Array.from(atob(zip), (one) => one.charCodeAt(0)), "application/zip");
    else save(name, text, "application/toml");
  } catch (problem) { fail(problem, "files"); }
}
find("#link").addEventListener("click", async () => {
  store.settle();
  store.toAddress();
  await navigator.clipboard?.writeText(location.href).catch(() => {});
  find("#link").textContent = "Copied";
  setTimeout(() => { find("#link").textContent = "Copy link"; }, 1200);
});
// Whether there was a design in the address; what is left out of it is said.
function fromAddress(later) {
  well("link");
  const left = store.fromAddress((key, value) => controls.ranges.refused(key, value), later);
  if (left?.length) fail(new Faults(left.map((words) => `left out of the link: ${words}`)), "link");
  return left !== null;
}
addEventListener("hashchange", () => { if (location.hash.length > 1) fromAddress(true); });

// --- taking away ---

let building = null, buildKey = "", begun = 0;
function filesKey() {
  const { spec, look: { own, ...look } } = store.now;
  return JSON.stringify([spec, look]);
}
const STEPS = ["designing", "writing and reading back", "curvature deviation", "tracing the driver", "decoupled and faithful", "report", "done"];
find("[data-take=pdf]").hidden = !start.kinds.includes("pdf");
for (const button of document.querySelectorAll("[data-take]")) button.addEventListener("click", () => take(button.dataset.take));
function take(kind) {
  well("files");
  if (kind === "spec") { saveSpec(); return; }
  if (kind === "picture") { savePicture(); return; }
  const { spec, look } = store.now, key = filesKey();
  building = kind;
  if (built?.key === key) { deliver(); return; }
  buildKey = key;
  begun = performance.now();
  find("#building").hidden = false;
  find("#build-step").textContent = "starting";
  progress("");
  if (!wire.ask({ type: "build", spec, look: { ...look, ...stage.room(look) } })) {
    endBuild();
    fail(new Error(`${SILENT}: the files can be made when it does`), "files");
  }
}
async function savePicture() {
  const { spec, look } = store.now;
  if (look.view === "road") {
    const picture = await pictureOf(stage);
    if (picture) save(`${spec.name}-road.png`, picture, "image/png");
    else fail(new Error("the picture is still a draft: take it when the fine one is there"), "files");
    return;
  }
  try {
    const body = JSON.stringify({ spec, look: { ...look, ...stage.room(look) } });
    save(`${spec.name}-view.png`, await postForFile("/picture", body), "image/png");
  } catch (problem) { fail(problem, "files"); }
}
function progress(step) {
  const at = STEPS.findIndex((text) => step.startsWith(text));
  find("#build-bar").value = (at + 1) / STEPS.length;
}
async function deliver(fresh) {
  const kind = building;
  endBuild();
  if (!kind) return;
  const path = `/files/${built.token}/${kind}`;
  const there = await fetch(path, { method: "HEAD" }).catch(() => null);
  if (!there?.ok) {
    built = null;
    if (fresh) fail(new Error(there ? "the files are no longer on the server: try again" : SILENT), "files");
    else take(kind); // the server was restarted
    return;
  }
  save("", path);
  madeOf = filesKey();
  const then = madeOf === built.key ? "" : " (of the design as it was when asked for)";
  const said = [...built.missed, ...built.notes];
  made.textContent = said.length ? `Made${then}, but: ${said.join("; ")}` : `Made and read back in ${((performance.now() - begun) / 1000).toFixed(1)} s${then}`;
  made.title = made.textContent;
  made.classList.toggle("warning", said.length > 0);
}
function endBuild() {
  building = null;
  find("#building").hidden = true;
}
find("#cancel").addEventListener("click", () => wire.ask({ type: "cancel" }));

// --- keyboard ---

addEventListener("keydown", (event) => {
  const typing = event.target.matches("input:not([type=range]):not([type=checkbox]), textarea");
  if (event.ctrlKey || event.metaKey) {
    const key = event.key.toLowerCase();
    if (key === "z" && !event.shiftKey) { event.preventDefault(); store.undo(); }
    if (key === "y" || (key === "z" && event.shiftKey)) { event.preventDefault(); store.redo(); }
    return;
  }
  if (typing || event.altKey || event.target.matches("select")) return;
  const press = { g: "#grid", e: "#eyes", p: "#pin", a: "#hold", l: "#reflection-lines", c: "#combs", r: store.now.look.view === "road" ? "#view-picture" : "#view-road", "?": "#help" }[event.key];
  if (press && !find(press).disabled) { event.preventDefault(); find(press).click(); }
});
const help = find("#help-text");
find("#help").addEventListener("click", () => help.showModal());
addEventListener("pagehide", () => store.settle());

if (!fromAddress()) changed(store.now);
if (start.study) front.ofStudio();
document.body.dataset.ready = "yes";
