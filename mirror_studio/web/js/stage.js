// The driver's view: pictures put on the screen, a 1° grid over them, and what lies under the pointer.

import { el, sharp, sizeOf, watch } from "./dom.js";

const RAD = Math.PI / 180;

export class Stage {
  constructor(canvas, readout, probe) {
    this.canvas = canvas;
    this.readout = readout;
    this.probe = probe;
    this.revision = 0;
    this.grid = false;
    this.asked = null;
    canvas.addEventListener("pointermove", (event) => this.hover(event));
    canvas.addEventListener("pointerleave", () => this.leave());
    canvas.addEventListener("keydown", (event) => this.key(event));
    canvas.addEventListener("blur", () => this.leave());
    watch(canvas, () => { this.draw(); this.resized?.(); });
  }

  // Room for pictures, in the screen's own pixels.
  get room() {
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = sizeOf(this.canvas).map((size) => Math.max(16, Math.min(4096, Math.round(size * ratio))));
    return { width, height };
  }

  async show(answer) {
    const names = Object.keys(answer.pictures);
    const images = await Promise.all(names.map((name) => createImageBitmap(answer.pictures[name])));
    if (this.answer && answer.id < this.answer.id) return false; // a newer one was decoded first
    this.images?.forEach((image) => image.close());
    [this.names, this.images, this.answer] = [names, images, answer];
    this.draw();
    // The next frame puts on the screen what is drawn now.
    requestAnimationFrame(() => {
      this.canvas.dataset.revision = String(++this.revision);
      this.presented?.(answer);
    });
    return true;
  }

  // While a pinned design is held against this one.
  overlay(image) {
    this.instead = image;
    this.draw();
  }

  draw() {
    const { context, width, height } = sharp(this.canvas);
    context.fillStyle = "#f6f6f4";
    context.fillRect(0, 0, width, height);
    this.places = [];
    if (!this.answer) return;
    const images = this.instead?.images ?? this.images, names = this.instead?.names ?? this.names, answer = this.instead?.answer ?? this.answer;
    const cell = width / images.length;
    context.imageSmoothingQuality = answer.fine ? "high" : "low";
    images.forEach((image, i) => {
      const scale = Math.min(cell / image.width, height / image.height);
      const w = image.width * scale, h = image.height * scale;
      const x = i * cell + 0.5 * (cell - w), y = 0.5 * (height - h);
      context.drawImage(image, x, y, w, h);
      const [, kind, eye] = names[i].match(/^(\D+)(\d)$/);
      const [left, top, pixel, columns] = answer.frames[kind];
      const place = { x, y, w, h, kind, eye: Number(eye), left, top, mm: (pixel * columns) / w };
      this.places.push(place);
      if (this.grid && kind === "picture") this.drawGrid(context, place, answer);
      if (names.length > 1) this.label(context, place, names.length);
    });
    if (this.cross) {
      const { x, y } = this.cross;
      context.strokeStyle = "rgba(255,255,255,.9)"; context.lineWidth = 3; crosshair(context, x, y);
      context.strokeStyle = "#111"; context.lineWidth = 1; crosshair(context, x, y);
    }
  }

  label(context, place) {
    const both = this.names.some((name) => name.endsWith("1"));
    const words = [place.kind === "own" ? "your mirror" : this.names.includes("own0") ? "the design" : "", both ? ["left eye", "right eye"][place.eye] : ""];
    context.font = "600 12px system-ui, sans-serif";
    context.fillStyle = "#333";
    context.textAlign = "center";
    context.fillText(words.filter(Boolean).join(", "), place.x + place.w / 2, Math.max(14, place.y + 14));
  }

  // Lines one degree apart in the driver's sight, about the direction to the middle of the mirror.
  drawGrid(context, place, answer) {
    const eye = answer.eyes_mm[place.eye], [x0, x1, y0, y1] = answer.box_mm;
    const middle = [0.5 * (x0 + x1) - eye[0], 0.5 * (y0 + y1) - eye[1], -eye[2]];
    const size = Math.hypot(...middle), forward = middle.map((v) => v / size);
    const right = normal([-forward[2], 0, forward[0]]), up = cross(right, forward);
    context.save();
    context.beginPath();
    context.rect(place.x, place.y, place.w, place.h);
    context.clip();
    const at = (a, b) => {
      const d = forward.map((f, i) => f + Math.tan(a) * right[i] + (Math.tan(b) / Math.cos(a)) * up[i]);
      const t = -eye[2] / d[2];
      return [place.x + (eye[0] + t * d[0] - place.left) / place.mm, place.y + (place.top - eye[1] - t * d[1]) / place.mm];
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
    context.restore();
  }

  hover(event) {
    const box = this.canvas.getBoundingClientRect();
    this.look(event.clientX - box.left, event.clientY - box.top);
  }

  leave() {
    this.cross = null;
    this.readout.textContent = "";
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
    const place = this.places?.find((p) => x >= p.x && x < p.x + p.w && y >= p.y && y < p.y + p.h);
    if (!place || place.kind !== "picture") { this.leave(); return; }
    this.cross = { x, y };
    this.at = { x: place.left + (x - place.x) * place.mm, y: place.top - (y - place.y) * place.mm, eye: place.eye };
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
    const times = (v) => (v === null ? "∞" : v.toFixed(3));
    const landed = found.landed_mm ? `lands at X ${(found.landed_mm[0] / 1000).toFixed(2)}, Y ${(found.landed_mm[1] / 1000).toFixed(2)} m`
      : "does not reach the picture plane";
    this.readout.replaceChildren(
      el("b", {}, `${times(found.across)} × ${times(found.up)}`), " of flat (across × up) · ", landed,
      ` · mirror (${x.toFixed(1)}, ${y.toFixed(1)}, ${z.toFixed(2)}) mm`);
  }
}

function crosshair(context, x, y) {
  context.beginPath();
  for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) { context.moveTo(x + 3 * dx, y + 3 * dy); context.lineTo(x + 9 * dx, y + 9 * dy); }
  context.stroke();
}

const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const normal = (a) => { const size = Math.hypot(...a); return a.map((v) => v / size); };
