// A study's designs: lines over parallel axes, points over pairs of figures, a table; brushed in any of them.
// Everything is drawn from typed arrays; above EXACT rows lines are drawn by bins, so that a brush follows the hand.
"use strict";
const head = JSON.parse(document.getElementById("head").textContent);
const EXACT = 4000, BINS = 48, COARSE_BINS = 20, SHADES = 12, MOST_PANELS = 5, ROW = 26, POINT = 3;
const $ = (id) => document.getElementById(id);
const make = (tag, of = {}, ...inside) => { const one = Object.assign(document.createElement(tag), of); one.append(...inside); return one; };

function bytes(id) {
  const text = atob(document.getElementById(id).textContent), found = new Uint8Array(text.length);
  for (let k = 0; k < text.length; k++) found[k] = text.charCodeAt(k);
  document.getElementById(id).textContent = "";
  return found.buffer;
}

const n = head.rows, data = new Float64Array(bytes("data"));
const columns = head.columns.map((column, c) => {
  const values = data.subarray(c * n, (c + 1) * n);
  let low = Infinity, high = -Infinity;
  for (const value of values) { if (value < low) low = value; if (value > high) high = value; }
  if (!(low <= high)) { low = 0; high = 1; }
  if (low === high) { low -= 0.5; high += 0.5; }
  // NaN stays NaN: what has no figure is in no place of the axis.
  const share = new Float32Array(n);
  for (let k = 0; k < n; k++) share[k] = (values[k] - low) / (high - low);
  return { ...column, values, share, low, high, brush: null };
});
const cause = new Uint16Array(bytes("cause")), front = new Uint8Array(n);
for (const k of head.front) front[k] = 1;
const chosen = new Uint8Array(n).fill(1), boxes = new Map(); // brushes of panels: "x,y" -> [x0, x1, y0, y1] in shares
let busy = false; // while a brush is drawn, what is drawn may be coarser
let left = n, listed = Uint32Array.from({ length: n }, (_, k) => k), sorted = null, opened = -1;
let colour = columns.findIndex((one) => one.measure), shown = columns.filter((one) => one.on);

const RAMP = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]]; // viridis
function shade(t) {
  const at = Math.min(Math.max(t, 0), 1) * (RAMP.length - 1), k = Math.min(Math.floor(at), RAMP.length - 2), f = at - k;
  return RAMP[k].map((one, c) => Math.round(one + f * (RAMP[k + 1][c] - one)));
}
const shades = Array.from({ length: SHADES }, (_, k) => shade(k / (SHADES - 1)));
const tone = (k) => { const t = columns[colour].share[k]; return t === t ? Math.min(Math.floor(t * SHADES), SHADES - 1) : -1; };
const words = (value, column) => column.words ? column.words[value] ?? "" : value !== value ? "" : Math.abs(value) >= 1e5 ||
  (value !== 0 && Math.abs(value) < 1e-3) ? value.toPrecision(5) : String(Number(value.toPrecision(column.measure ? 6 : 8)));

// --- canvases ---------------------------------------------------------------------------------------------------------

function sized(canvas, width, height) {
  const ratio = window.devicePixelRatio || 1;
  canvas.width = Math.round(width * ratio); canvas.height = Math.round(height * ratio);
  canvas.style.width = `${width}px`; canvas.style.height = `${height}px`;
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return context;
}

const TOP = 66, BOTTOM = 22, SIDE = 60, LINE = 14;
const lines = { base: make("canvas"), over: $("lines"), width: 0, height: 362 };
const axisX = (i) => SIDE + (shown.length > 1 ? i * (lines.width - 2 * SIDE) / (shown.length - 1) : 0);
const axisY = (t) => lines.height - BOTTOM - t * (lines.height - TOP - BOTTOM);

// Lines between two axes for the rows that `counts` says, in one colour or by their tone.
function segments(context, i, counts, plain) {
  const a = shown[i].share, b = shown[i + 1].share, x0 = axisX(i), x1 = axisX(i + 1);
  if (n <= EXACT) {
    const paths = new Map();
    for (let k = 0; k < n; k++) {
      if (!counts[k] || a[k] !== a[k] || b[k] !== b[k]) continue;
      const of = plain ? 0 : tone(k);
      if (!paths.has(of)) paths.set(of, new Path2D());
      const path = paths.get(of);
      path.moveTo(x0, axisY(a[k])); path.lineTo(x1, axisY(b[k]));
    }
    context.globalAlpha = plain ? 0.5 : Math.min(0.85, Math.max(0.12, 60 / Math.sqrt(left * 20 + 1)));
    for (const [of, path] of paths) { context.strokeStyle = plain ?? (of < 0 ? "#999" : `rgb(${shades[of]})`); context.stroke(path); }
  } else {
    const bins = busy ? COARSE_BINS : BINS, many = new Uint32Array(bins * bins), sum = new Float32Array(bins * bins);
    const t = columns[colour].share;
    let most = 0;
    for (let k = 0; k < n; k++) {
      if (!counts[k] || a[k] !== a[k] || b[k] !== b[k]) continue;
      const bin = Math.min((a[k] * bins) | 0, bins - 1) * bins + Math.min((b[k] * bins) | 0, bins - 1);
      if (++many[bin] > most) most = many[bin];
      sum[bin] += t[k] === t[k] ? t[k] : 0.5;
    }
    const paths = new Map(), scale = 4 / Math.log(1 + most);
    for (let bin = 0; bin < bins * bins; bin++) {
      if (!many[bin]) continue;
      const weight = Math.max(1, Math.ceil(scale * Math.log(1 + many[bin])));
      const of = plain ? weight : weight * 100 + Math.min(Math.floor(sum[bin] / many[bin] * SHADES), SHADES - 1);
      if (!paths.has(of)) paths.set(of, new Path2D());
      const path = paths.get(of);
      path.moveTo(x0, axisY((Math.floor(bin / bins) + 0.5) / bins)); path.lineTo(x1, axisY((bin % bins + 0.5) / bins));
    }
    for (const [of, path] of [...paths].sort((p, q) => p[0] - q[0])) {
      context.globalAlpha = (plain ? 0.12 : 0.16) * (plain ? of : Math.floor(of / 100));
      context.strokeStyle = plain ?? `rgb(${shades[of % 100]})`;
      context.stroke(path);
    }
  }
  context.globalAlpha = 1;
}

// A title in as many lines as fit above an axis, the last of which takes the rest.
function wrapped(context, text, room) {
  const found = [""];
  for (const word of text.split(/(?<=[ _.])/)) {
    if (found.length < 3 && found.at(-1) && context.measureText(found.at(-1) + word.trimEnd()).width > room) found.push("");
    found[found.length - 1] += word;
  }
  return found;
}
const end = (one, value) => (one.words ? one.words[Math.round(value)] ?? "" : String(Number(value.toPrecision(4))));

const every = new Uint8Array(n).fill(1);
function drawBase() {
  lines.width = $("lines-box").clientWidth;
  const context = sized(lines.base, lines.width, lines.height);
  for (let i = 0; i + 1 < shown.length; i++) segments(context, i, every, "#d3d9de");
}

function drawLines() {
  const context = sized(lines.over, lines.width, lines.height);
  context.drawImage(lines.base, 0, 0, lines.width, lines.height);
  context.lineWidth = 1;
  for (let i = 0; i + 1 < shown.length; i++) segments(context, i, chosen, null);
  const strong = (k, style) => {
    context.strokeStyle = style; context.lineWidth = 1.6; context.beginPath();
    let open = false;
    shown.forEach((one, i) => {
      const t = one.share[k];
      if (t !== t) { open = false; return; }
      if (open) context.lineTo(axisX(i), axisY(t)); else context.moveTo(axisX(i), axisY(t));
      open = true;
    });
    context.stroke();
  };
  for (const k of head.front.length <= 400 ? head.front : []) if (chosen[k]) strong(k, "#c2410c");
  if (opened >= 0) strong(opened, "#111");
  context.font = "12px system-ui, sans-serif"; context.lineWidth = 1;
  shown.forEach((one, i) => {
    const x = axisX(i);
    context.strokeStyle = "#5b6670"; context.beginPath(); context.moveTo(x, axisY(0)); context.lineTo(x, axisY(1)); context.stroke();
    context.fillStyle = "#1d2329"; context.textAlign = "center";
    const room = Math.min(2 * SIDE, shown.length > 1 ? (lines.width - 2 * SIDE) / (shown.length - 1) - 6 : 300);
    wrapped(context, one.title, room).forEach((line, k) => context.fillText(line, x, 11 + LINE * k, room));
    context.fillStyle = "#5b6670";
    context.fillText(end(one, one.high), x, TOP - 6, room);
    context.fillText(end(one, one.low), x, lines.height - 6, room);
    if (one.brush) {
      context.fillStyle = "rgba(31, 90, 146, 0.25)"; context.strokeStyle = "#1f5a92";
      const y = axisY(one.brush[1]), h = axisY(one.brush[0]) - y;
      context.fillRect(x - 7, y, 14, h); context.strokeRect(x - 7, y, 14, h);
    }
  });
}

// --- the scatter matrix -----------------------------------------------------------------------------------------------

const PANEL = 190, GAP = 16;
let panels = [];
function layPanels() {
  const of = shown.filter((one) => one.measure).slice(0, MOST_PANELS);
  const grid = $("matrix");
  grid.replaceChildren(); panels = [];
  grid.style.gridTemplateColumns = `repeat(${Math.max(of.length - 1, 1)}, ${PANEL}px)`;
  for (let r = 1; r < of.length; r++) {
    for (let c = 0; c < of.length - 1; c++) {
      if (c >= r) { grid.append(make("span")); continue; }
      const canvas = make("canvas"), x = of[c], y = of[r];
      canvas.title = `${x.title} across, ${y.title} upright: drag to choose`;
      grid.append(make("figure", {}, canvas, make("figcaption", { textContent: `${x.title} → · ${y.title} ↑` })));
      const panel = { canvas, x, y, key: `${x.name},${y.name}`, context: sized(canvas, PANEL, PANEL), base: null };
      panel.base = paint(panel, every, true);
      panels.push(panel);
      dragPanel(panel);
    }
  }
}

function paint(panel, counts, plain) {
  const w = panel.canvas.width, h = panel.canvas.height, size = Math.round(POINT * (window.devicePixelRatio || 1) * (n > EXACT ? 0.5 : 1));
  const image = panel.base && !plain ? new ImageData(new Uint8ClampedArray(panel.base.data), w, h) : new ImageData(w, h);
  const pixels = new Uint32Array(image.data.buffer), a = panel.x.share, b = panel.y.share, edge = 6;
  const tones = shades.map(([r, g, bl]) => 0xff000000 | bl << 16 | g << 8 | r);
  const spot = (k, value, wide) => {
    const x = Math.round(edge + a[k] * (w - 2 * edge - 1)) - (wide >> 1), y = Math.round(h - 1 - edge - b[k] * (h - 2 * edge - 1)) - (wide >> 1);
    for (let j = 0; j < wide; j++) for (let i = 0; i < wide; i++) pixels[(y + j) * w + x + i] = value;
  };
  if (plain) pixels.fill(0xfff8f7f5);
  for (let k = 0; k < n; k++) {
    if (!counts[k] || a[k] !== a[k] || b[k] !== b[k]) continue;
    const of = plain ? -1 : tone(k);
    spot(k, plain ? 0xffdcd5cf : of < 0 ? 0xff999999 : tones[of], size);
  }
  if (!plain) {
    for (const k of head.front) if (chosen[k] && a[k] === a[k] && b[k] === b[k]) spot(k, 0xff0c41c2, size + 2);
    if (opened >= 0 && a[opened] === a[opened] && b[opened] === b[opened]) spot(opened, 0xff111111, size + 4);
  }
  return image;
}

function drawPanels() {
  for (const panel of panels) {
    panel.context.putImageData(paint(panel, chosen, false), 0, 0);
    const box = boxes.get(panel.key);
    if (!box) continue;
    const at = (t) => 6 + t * (PANEL - 13);
    panel.context.strokeStyle = "#1f5a92"; panel.context.fillStyle = "rgba(31, 90, 146, 0.12)";
    const rest = [at(box[0]), PANEL - 1 - at(box[3]), at(box[1]) - at(box[0]), at(box[3]) - at(box[2])];
    panel.context.fillRect(...rest); panel.context.strokeRect(...rest);
  }
}

// --- what is chosen ---------------------------------------------------------------------------------------------------

function choose() {
  chosen.fill(1);
  const keep = (share, low, high) => { for (let k = 0; k < n; k++) if (!(share[k] >= low && share[k] <= high)) chosen[k] = 0; };
  for (const one of columns) if (one.brush) keep(one.share, ...one.brush);
  for (const panel of panels) {
    const box = boxes.get(panel.key);
    if (box) { keep(panel.x.share, box[0], box[1]); keep(panel.y.share, box[2], box[3]); }
  }
  if ($("only-front").checked) for (let k = 0; k < n; k++) chosen[k] &= front[k];
  left = 0;
  for (let k = 0; k < n; k++) left += chosen[k];
  document.body.dataset.chosen = left;
  $("count").textContent = left === n ? `all ${n} designs` : `${left} of ${n} designs`;
}

let due = 0, resting = 0;
function refresh() {
  if (due) return;
  due = requestAnimationFrame(() => {
    due = 0;
    const began = performance.now();
    choose(); drawLines(); drawPanels();
    document.body.dataset.frame = (performance.now() - began).toFixed(1);
    clearTimeout(resting);
    resting = setTimeout(list, n > EXACT ? 120 : 0);
  });
}

function list() {
  listed = new Uint32Array(left);
  for (let k = 0, m = 0; k < n; k++) if (chosen[k]) listed[m++] = k;
  if (sorted) {
    const { values } = columns[sorted.column], sign = sorted.down ? -1 : 1;
    const key = (k) => (values[k] === values[k] ? sign * values[k] : Infinity); // what has no figure comes last
    listed.sort((a, b) => key(a) - key(b) || a - b);
  }
  $("list-size").style.height = `${listed.length * ROW}px`;
  drawList();
}

function drawList() {
  const box = $("list"), from = Math.max(0, Math.floor(box.scrollTop / ROW) - 4);
  const to = Math.min(listed.length, from + Math.ceil(box.clientHeight / ROW) + 10);
  const body = $("list-rows");
  body.style.transform = `translateY(${from * ROW}px)`;
  body.replaceChildren(...Array.from(listed.subarray(from, to), (k) => {
    const one = make("div", { className: `row${front[k] ? " front" : ""}${k === opened ? " opened" : ""}` },
      make("span", { textContent: head.numbers ? head.numbers[k] : k }), ...columns.map((column) => make("span", { textContent: words(column.values[k], column) })),
      make("span", { textContent: cause[k] ? head.causes[cause[k] - 1] : front[k] ? "on the front" : "ok", title: cause[k] ? head.causes[cause[k] - 1] : "" }));
    one.dataset.row = k;
    return one;
  }));
}

// --- a design opened --------------------------------------------------------------------------------------------------

const encode = (value) => (typeof value === "string" && !/^[-+0-9.[{"tfn]/.test(value) ? encodeURIComponent(value)
  : encodeURIComponent(JSON.stringify(value)).replaceAll("%2C", ",").replaceAll("%5B", "[").replaceAll("%5D", "]"));
function keysOf(k) {
  return Object.fromEntries(columns.filter((one) => !one.measure).map((one) => [one.name, one.words ? one.words[one.values[k]] : one.values[k]]));
}
// The studio's address: its preset, and all that differs from it. An entry of a list is told with its whole list.
function address(k) {
  const own = { ...head.studio.differs };
  for (const [key, value] of Object.entries(keysOf(k))) {
    const entry = key.match(/^(.*)\.(\d+)$/);
    if (!entry) { own[key] = value; continue; }
    own[entry[1]] = [...(own[entry[1]] ?? head.lists[entry[1]])];
    own[entry[1]][Number(entry[2])] = value;
  }
  const parts = Object.entries(own).map(([key, value]) => `${key}=${value === null ? "" : encode(value)}`);
  return `http://127.0.0.1:${$("port").value}/#${[head.studio.preset, ...parts].join("&")}`;
}
function open(k) {
  opened = k;
  document.body.dataset.opened = k;
  $("design").hidden = false;
  $("design-title").textContent = `Design ${head.numbers ? head.numbers[k] : k}`;
  $("design-keys").textContent = Object.entries(keysOf(k)).map(([key, value]) => `"${key}" = ${JSON.stringify(value)}`).join("\n");
  $("design-figures").replaceChildren(...columns.filter((one) => one.measure).flatMap((one) => [
    make("dt", { textContent: one.title }), make("dd", { textContent: `${words(one.values[k], one) || "not shown"} ${one.unit}` })]),
  ...(cause[k] ? [make("dt", { textContent: "cause" }), make("dd", { textContent: head.causes[cause[k] - 1] })] : []));
  $("design-open").href = address(k);
  refresh(); drawList();
}

// --- hands ------------------------------------------------------------------------------------------------------------

function dragging(element, begin, move, done) {
  element.addEventListener("pointerdown", (event) => {
    const from = begin(event);
    if (from === null) return;
    element.setPointerCapture(event.pointerId);
    const on = (each) => { busy = n > EXACT; move(from, each); refresh(); };
    element.addEventListener("pointermove", on);
    element.addEventListener("pointerup", (each) => { element.removeEventListener("pointermove", on); busy = false; done(from, each); refresh(); },
      { once: true });
  });
}
const clip = (t) => Math.min(1, Math.max(0, t));
const overLines = (event) => { const box = lines.over.getBoundingClientRect(); return [event.clientX - box.left, event.clientY - box.top]; };
const shareAt = (y) => clip((lines.height - BOTTOM - y) / (lines.height - TOP - BOTTOM));
dragging($("lines"), (event) => {
  const [x, y] = overLines(event);
  let near = -1, best = 28;
  shown.forEach((_, i) => { if (Math.abs(axisX(i) - x) < best) { best = Math.abs(axisX(i) - x); near = i; } });
  return near < 0 ? null : { one: shown[near], t: shareAt(y) };
}, (from, event) => {
  const t = shareAt(overLines(event)[1]);
  from.one.brush = [Math.min(from.t, t), Math.max(from.t, t)];
}, (from) => { if (from.one.brush && from.one.brush[1] - from.one.brush[0] < 0.01) from.one.brush = null; });

function dragPanel(panel) {
  const at = (event) => { const box = panel.canvas.getBoundingClientRect(); return [clip((event.clientX - box.left - 6) / (PANEL - 13)), clip((PANEL - 7 - event.clientY + box.top) / (PANEL - 13))]; };
  dragging(panel.canvas, at, (from, event) => {
    const to = at(event);
    boxes.set(panel.key, [Math.min(from[0], to[0]), Math.max(from[0], to[0]), Math.min(from[1], to[1]), Math.max(from[1], to[1])]);
  }, (from, event) => {
    const to = at(event);
    if (Math.hypot(to[0] - from[0], to[1] - from[1]) > 0.02) return;
    boxes.delete(panel.key); // a click: the nearest design
    let best = 0.0016, near = -1;
    for (let k = 0; k < n; k++) {
      const d = (panel.x.share[k] - to[0]) ** 2 + (panel.y.share[k] - to[1]) ** 2;
      if (chosen[k] && d < best) { best = d; near = k; }
    }
    if (near >= 0) open(near);
  });
}

$("list").addEventListener("scroll", drawList, { passive: true });
$("list-rows").addEventListener("click", (event) => { const row = event.target.closest(".row"); if (row) open(Number(row.dataset.row)); });
$("only-front").addEventListener("change", refresh);
$("only-front").parentElement.hidden = head.front.length === 0;
$("clear").addEventListener("click", () => { for (const one of columns) one.brush = null; boxes.clear(); $("only-front").checked = false; refresh(); });
$("port").addEventListener("change", () => { if (opened >= 0) $("design-open").href = address(opened); });
$("design-copy").addEventListener("click", () => navigator.clipboard?.writeText($("design-keys").textContent));
$("colour").append(...columns.map((one, c) => make("option", { value: c, textContent: one.title, selected: c === colour })));
$("colour").addEventListener("change", (event) => { colour = Number(event.target.value); refresh(); });
function axes() { shown = columns.filter((one) => one.on); drawBase(); layPanels(); refresh(); }
$("axes").append(...columns.map((one) => {
  const box = make("input", { type: "checkbox", checked: one.on });
  box.addEventListener("change", () => { one.on = box.checked; if (!one.on) one.brush = null; axes(); });
  return make("label", {}, box, ` ${one.title}`);
}));
$("list-head").append(make("span", { textContent: "no." }), ...columns.map((one, c) => {
  const cell = make("span", { textContent: one.title + (one.unit ? `, ${one.unit}` : ""), title: one.definition ?? one.name });
  cell.addEventListener("click", () => { sorted = { column: c, down: sorted?.column === c && !sorted.down }; list(); });
  return cell;
}), make("span", { textContent: "status" }));
document.documentElement.style.setProperty("--columns", columns.length);

// --- how far it is from settled ---------------------------------------------------------------------------------------

function settledChart() {
  const points = head.settled, box = $("settled-chart");
  if (!points.length) return;
  const w = 460, h = 130, most = points.at(-1)[0], values = points.map((one) => one[1]), low = Math.min(...values), high = Math.max(...values);
  const x = (v) => 44 + (w - 54) * v / most, y = (v) => h - 20 - (h - 32) * (high > low ? (v - low) / (high - low) : 0.5);
  let path = `M${x(points[0][0])},${y(points[0][1])}`;
  points.slice(1).forEach((one, k) => { path += `L${x(one[0])},${y(points[k][1])}L${x(one[0])},${y(one[1])}`; });
  box.innerHTML = `<svg viewBox="0 0 ${w} ${h}" role="img" aria-label="${head.settledTitle} over evaluations"><path d="M44,12V${h - 20}H${w - 10}" fill="none" stroke="#9aa5ae"/><path d="${path}" fill="none" stroke="#1f5a92" stroke-width="1.6"/><text x="40" y="16" text-anchor="end">${high.toPrecision(4)}</text><text x="40" y="${h - 20}" text-anchor="end">${low.toPrecision(4)}</text><text x="${w - 10}" y="${h - 6}" text-anchor="end">${most} evaluations</text></svg>`;
}

let width = 0;
new ResizeObserver(() => { if ($("lines-box").clientWidth !== width) { width = $("lines-box").clientWidth; drawBase(); refresh(); } }).observe($("lines-box"));
settledChart();
axes();
requestAnimationFrame(() => requestAnimationFrame(() => { document.body.dataset.ready = performance.now().toFixed(0); }));
