// The driver's view: pictures put on the screen, a 1° grid over them, and what lies under the pointer.

import { cameraOf, cross, normal } from "./camera.js";
import { el, sharp, sizeOf, watch } from "./dom.js";
import { fixed } from "./numbers.js";
import { metInWords } from "./road.js";

const RAD = Math.PI / 180;
const LABEL = 18; // CSS pixels above each of several pictures
const HELD = "This is the pinned design A: what lies under the pointer is told of the design at hand";

export class Stage {
  // due: whether answers are. presented: told of each answer when it is on the screen.
  constructor(canvas, readout, { probe, due, presented }) {
    this.canvas = canvas;
    this.readout = readout;
    Object.assign(this, { probe, due, presented });
    this.revision = 0;
    this.grid = false;
    this.asked = null;
    canvas.addEventListener("pointerdown", (event) => {
      if (this.instead || !this.nodes?.down(event.offsetX, event.offsetY, this.places ?? [], this.answer)) return;
      event.preventDefault();
      canvas.setPointerCapture(event.pointerId);
      this.leave();
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { if (this.nodes?.held) this.nodes.up(); });
    canvas.addEventListener("pointermove", (event) => {
      if (this.nodes?.held) this.nodes.move(event.offsetX, event.offsetY);
      else this.hover(event);
    });
    canvas.addEventListener("pointerleave", () => { if (!this.nodes?.held) this.leave(); });
    canvas.addEventListener("keydown", (event) => this.key(event));
    canvas.addEventListener("blur", () => this.leave());
    watch(canvas, () => { this.draw(); this.resized?.(); });
  }

  // Room for the pictures of a look, in the screen's own pixels: without that of their labels.
  room({ eyes, own }) {
    const ratio = window.devicePixelRatio || 1, [width, height] = sizeOf(this.canvas);
    const labels = eyes === "both" || own ? LABEL * (this.answer?.layout?.[1] ?? 1) : 0;
    const pixels = (size) => Math.max(16, Math.min(4096, Math.round(size * ratio)));
    return { width: pixels(width), height: pixels(height - labels) };
  }

  // A picture is drawn in the first frame after it was decoded, and only the newest: `expect` looks for one in every frame
  // while answers are due.
  async show(answer) {
    const names = Object.keys(answer.pictures);
    const images = await Promise.all(names.map((name) => createImageBitmap(answer.pictures[name])));
    if (Math.max(this.answer?.id ?? 0, this.decoded?.answer.id ?? 0) > answer.id) return; // a newer one was decoded first
    this.decoded?.images.forEach((image) => image.close());
    this.decoded = { names, images, answer };
    this.expect();
  }

  expect() {
    if (this.expecting) return;
    this.expecting = true;
    const frame = () => {
      if (this.decoded) this.present();
      this.expecting = this.due();
      if (this.expecting) requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }

  // In the frame that brings it to the screen.
  present() {
    this.images?.forEach((image) => image.close());
    Object.assign(this, this.decoded);
    this.decoded = null;
    this.draw();
    this.canvas.dataset.revision = String(++this.revision);
    this.presented(this.answer);
  }

  // While a pinned design is held against this one.
  overlay(image) {
    this.instead = image;
    this.leave();
  }

  draw() {
    const { context, width, height } = sharp(this.canvas);
    context.fillStyle = "#f6f6f4";
    context.fillRect(0, 0, width, height);
    this.places = [];
    if (!this.answer) return;
    const images = this.instead?.images ?? this.images, names = this.instead?.names ?? this.names, answer = this.instead?.answer ?? this.answer;
    const [columns, rows] = answer.layout, head = images.length > 1 ? LABEL : 0;
    const cell = width / columns, band = height / rows - head;
    const scale = Math.min(...images.map((image) => Math.min(cell / image.width, band / image.height))); // one for all
    context.imageSmoothingQuality = answer.fine ? "high" : "low";
    images.forEach((image, i) => {
      const w = image.width * scale, h = image.height * scale, row = Math.floor(i / columns);
      const x = (i % columns) * cell + 0.5 * (cell - w), y = row * (band + head) + head + 0.5 * (band - h);
      context.drawImage(image, x, y, w, h);
      const [, kind, eye] = names[i].match(/^(\D+)(\d)$/);
      const camera = cameraOf(answer, names[i], kind, Number(eye));
      const place = { x, y, w, h, kind, eye: Number(eye), camera, size: w / camera.columns };
      this.places.push(place);
      if (this.grid && kind === "picture") this.drawGrid(context, place, answer);
      if (kind === "picture" && answer === this.answer) this.nodes?.draw(context, place, answer);
      if (names.length > 1) label(context, place, names, answer, this.ownWords?.() ?? "your mirror");
    });
    if (this.cross) {
      const { x, y } = this.cross;
      context.strokeStyle = "rgba(255,255,255,.9)"; context.lineWidth = 3; crosshair(context, x, y);
      context.strokeStyle = "#111"; context.lineWidth = 1; crosshair(context, x, y);
    }
  }

  // Lines one degree apart in the driver's sight, about the direction to the middle of the mirror.
  drawGrid(context, place, answer) {
    const eye = answer.eyes_mm[place.eye], [x0, x1, y0, y1] = answer.box_mm;
    const middle = [0.5 * (x0 + x1) - eye[0], 0.5 * (y0 + y1) - eye[1], -eye[2]];
    const forward = normal(middle), { right, up } = place.camera.axes ?? { right: normal([-forward[2], 0, forward[0]]), up: null };
    const upward = up ?? cross(right, forward);
    context.save();
    context.beginPath();
    context.rect(place.x, place.y, place.w, place.h);
    context.clip();
    const at = (a, b) => {
      const d = forward.map((f, i) => f + Math.tan(a) * right[i] + (Math.tan(b) / Math.cos(a)) * upward[i]);
      const [column, row] = place.camera.pixel(d);
      return [place.x + column * place.size, place.y + row * place.size];
    };
    const most = 16;
    for (const along of [0, 1]) {
      for (let k = -most; k <= most; k++) {
        context.beginPath();
        for (let j = -most; j <= most; j++) context.lineTo(...(along ? at(j * RAD, k * RAD) : at(k * RAD, j * RAD)));
        context.strokeStyle = k % 5 ? "rgba(255,255,255,.45)" : "rgba(255,255,255,.9)";
        context.lineWidth = k % 5 ? 1 : 1.5;
        context.stroke();
      }
    }
    context.font = "11px system-ui, sans-serif";
    context.textAlign = "left";
    for (let k = -15; k <= 15; k += 5) {
      const words = `${fixed(k, 0)}°`, wide = context.measureText(words).width + 6;
      for (const [x, y] of k ? [at(k * RAD, 0), at(0, k * RAD)] : [at(0, 0)]) {
        const whole = x > place.x && x + wide < place.x + place.w && y - 14 > place.y && y < place.y + place.h;
        if (whole) outlined(context, words, x + 3, y - 3);
      }
    }
    context.restore();
  }

  hover(event) {
    const box = this.canvas.getBoundingClientRect();
    this.look(event.clientX - box.left, event.clientY - box.top);
  }

  leave(words = "") {
    this.cross = null;
    this.readout.textContent = words;
    this.draw();
  }

  key(event) {
    const move = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (!move || !this.places?.length) return;
    event.preventDefault();
    const size = event.shiftKey ? 20 : 4, from = this.cross ?? { x: this.canvas.clientWidth / 2, y: this.canvas.clientHeight / 2 };
    this.look(from.x + size * move[0], from.y + size * move[1]);
  }

  look(x, y) {
    if (this.instead) { this.leave(HELD); return; }
    const place = this.places?.find((p) => x >= p.x && x < p.x + p.w && y >= p.y && y < p.y + p.h);
    if (!place || place.kind !== "picture") { this.leave(); return; }
    this.cross = { x, y };
    const [at_x, at_y] = place.camera.plane((x - place.x) / place.size, (y - place.y) / place.size);
    this.at = { x: at_x, y: at_y, eye: place.eye };
    this.draw();
    if (this.asked === null) this.ask();
  }

  ask() {
    this.asked = this.at;
    if (!this.probe(this.at)) this.asked = null;
  }

  probed(found) {
    const moved = this.asked !== this.at;
    this.asked = null;
    if (!this.cross) return;
    if (moved) this.ask();
    if (!found) { this.readout.textContent = "beside the mirror"; return; }
    const [x, y, z] = found.mirror_mm;
    const times = (v) => (v === null ? "∞" : fixed(v, 3));
    const landed = found.road ? metInWords(found.road) : found.landed_mm ? `lands at X ${fixed(found.landed_mm[0] / 1000, 2)}, Y ${fixed(found.landed_mm[1] / 1000, 2)} m`
      : "does not reach the picture plane";
    this.readout.replaceChildren(
      el("b", {}, `${times(found.across)} × ${times(found.up)}`), " of flat (across × up) · ", landed,
      ` · mirror (${fixed(x, 1)}, ${fixed(y, 1)}, ${fixed(z, 2)}) mm`);
  }
}

// Whose picture it is, above it.
function label(context, { kind, eye, x, y, w }, names, { sizes_mm: sizes }, own) {
  const size = () => `, ${sizes[kind].map((mm) => fixed(mm, 0)).join(" × ")} mm`;
  const whose = names.includes("own0") ? `${kind === "own" ? own : "the design"}${size()}` : "";
  const words = [whose, names.some((name) => name.endsWith("1")) ? ["left eye", "right eye"][eye] : ""].filter(Boolean).join(", ");
  context.font = "600 12px system-ui, sans-serif";
  context.textAlign = "center";
  context.fillStyle = "#333";
  context.fillText(words, x + w / 2, y - 5);
}

function outlined(context, ...at) {
  context.strokeStyle = "rgba(0,0,0,.6)";
  context.lineWidth = 3;
  context.strokeText(...at);
  context.fillStyle = "#fff";
  context.fillText(...at);
}

function crosshair(context, x, y) {
  context.beginPath();
  for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) { context.moveTo(x + 3 * dx, y + 3 * dy); context.lineTo(x + 9 * dx, y + 9 * dy); }
  context.stroke();
}

