// The curvature map as the mirror lies flat, and the plan of the plane behind the driver with what is seen of it.

import { coloured } from "./colours.js";
import { roundStep, sharp, watch } from "./dom.js";
import { drawGround } from "./ground.js";

export class FlatMap {
  constructor(canvas) {
    this.canvas = canvas;
    this.small = document.createElement("canvas");
    watch(canvas, () => this.draw());
  }

  show(answer, quantity) {
    this.answer = answer;
    this.quantity = quantity;
    this.draw();
  }

  draw() {
    if (!this.answer) return;
    const { arrays, box_mm: [x0, x1, y0, y1] } = this.answer;
    const { shares, rgb, cells } = coloured(this.quantity, arrays);
    const [nx, ny] = (cells ? arrays.measured_stands : arrays.z).shape;
    this.small.width = nx;
    this.small.height = ny;
    const image = new ImageData(nx, ny);
    for (let i = 0; i < nx; i++) {
      for (let j = 0; j < ny; j++) {
        const to = 4 * ((ny - 1 - j) * nx + i);
        image.data.set(rgb(shares[i * ny + j]), to);
        image.data[to + 3] = 255;
      }
    }
    this.small.getContext("2d").putImageData(image, 0, 0);
    const { context, width, height } = sharp(this.canvas);
    context.fillStyle = "#fff";
    context.fillRect(0, 0, width, height);
    const scale = Math.min((width - 8) / (x1 - x0), (height - 8) / (y1 - y0));
    const px = (x) => width / 2 + (x - 0.5 * (x0 + x1)) * scale, py = (y) => height / 2 - (y - 0.5 * (y0 + y1)) * scale;
    const { data } = arrays.outline;
    context.save();
    context.beginPath();
    for (let i = 0; i < data.length; i += 2) context.lineTo(px(data[i]), py(data[i + 1]));
    context.closePath();
    context.clip();
    context.imageSmoothingQuality = "high";
    // The samples stand on the box's edges: the middles of the picture's outermost elements.
    const dx = cells ? 0 : (x1 - x0) / (nx - 1), dy = cells ? 0 : (y1 - y0) / (ny - 1), [a0, a1, b0, b1] = cells ? this.answer.cells_mm : [x0, x1, y0, y1];
    context.imageSmoothingEnabled = !cells;
    context.drawImage(this.small, px(a0 - dx / 2), py(b1 + dy / 2), (a1 - a0 + dx) * scale, (b1 - b0 + dy) * scale);
    context.imageSmoothingEnabled = true;
    context.restore();
    // Where a place of the canvas lies on the mirror, mm.
    this.toMirror = (x, y) => [(x - width / 2) / scale + 0.5 * (x0 + x1), (height / 2 - y) / scale + 0.5 * (y0 + y1)];
    context.strokeStyle = "#555";
    context.stroke();
  }
}

export class Plan {
  constructor(canvas) {
    this.canvas = canvas;
    watch(canvas, () => this.draw());
  }

  // A draft of the road has no ground yet: the last one stays.
  show(answer, lane, pinned) {
    const drafted = answer.road && !answer.arrays.seen_both;
    if (!drafted) this.answer = answer;
    Object.assign(this, { lane, pinned });
    this.draw();
  }

  draw() {
    if (!this.answer) return;
    if (this.answer.road) { drawGround(this.canvas, this.answer, this.pinned?.answer.arrays.seen_left && this.pinned.answer.arrays); return; }
    const { arrays, scene_mm: scene } = this.answer;
    const { context, width, height } = sharp(this.canvas);
    context.fillStyle = "#fff";
    context.fillRect(0, 0, width, height);
    const seen = Object.keys(arrays).filter((name) => name.startsWith("ground")).map((name) => arrays[name].data);
    let [x0, x1, y0, y1] = scene;
    const far = 2.5 * Math.max(x1 - x0, y1 - y0);
    const middle = [0.5 * (x0 + x1), 0.5 * (y0 + y1)];
    for (const data of seen) {
      for (let i = 0; i < data.length; i += 2) {
        if (Math.abs(data[i] - middle[0]) < far && Math.abs(data[i + 1] - middle[1]) < far) {
          x0 = Math.min(x0, data[i]); x1 = Math.max(x1, data[i]);
          y0 = Math.min(y0, data[i + 1]); y1 = Math.max(y1, data[i + 1]);
        }
      }
    }
    const pad = { left: 26, bottom: 16, top: 6, right: 6 };
    const scale = Math.min((width - pad.left - pad.right) / (x1 - x0), (height - pad.top - pad.bottom) / (y1 - y0));
    const left = pad.left + 0.5 * (width - pad.left - pad.right - (x1 - x0) * scale);
    const top = pad.top + 0.5 * (height - pad.top - pad.bottom - (y1 - y0) * scale);
    const px = (x) => left + (x - x0) * scale, py = (y) => top + (y1 - y) * scale;
    context.font = "10px system-ui, sans-serif";
    context.fillStyle = "#667";
    const step = roundStep(Math.max(x1 - x0, y1 - y0), 5);
    context.textAlign = "center";
    for (let x = Math.ceil(x0 / step) * step; x <= x1; x += step) context.fillText(`${x / 1000}`, px(x), top + (y1 - y0) * scale + 12);
    context.textAlign = "right";
    for (let y = Math.ceil(y0 / step) * step; y <= y1; y += step) context.fillText(`${y / 1000}`, left - 4, py(y) + 3);
    context.fillStyle = "#e4e6ea";
    context.fillRect(px(scene[0]), py(scene[3]), (scene[1] - scene[0]) * scale, (scene[3] - scene[2]) * scale);
    context.strokeStyle = "#b9bdc6";
    context.strokeRect(px(scene[0]), py(scene[3]), (scene[1] - scene[0]) * scale, (scene[3] - scene[2]) * scale);
    context.save();
    context.beginPath();
    context.rect(left, top, (x1 - x0) * scale, (y1 - y0) * scale);
    context.clip();
    const height_of = (x) => this.lane.y0_mm + this.lane.slope * (x - this.lane.x0_mm);
    context.strokeStyle = "#a8791a";
    context.lineWidth = 1.5;
    context.beginPath();
    context.moveTo(px(x0), py(height_of(x0)));
    context.lineTo(px(x1), py(height_of(x1)));
    context.stroke();
    const polygon = (data, colour, fill, dash) => {
      context.beginPath();
      let on = false;
      for (let i = 0; i <= data.length; i += 2) {
        const x = data[i % data.length], y = data[(i + 1) % data.length];
        if (!Number.isFinite(x)) { on = false; continue; }
        if (on) context.lineTo(px(x), py(y)); else context.moveTo(px(x), py(y));
        on = true;
      }
      context.setLineDash(dash);
      context.strokeStyle = colour;
      context.lineWidth = 1.5;
      if (fill) { context.fillStyle = fill; context.fill(); }
      context.stroke();
      context.setLineDash([]);
    };
    if (this.pinned) for (const data of this.pinned.ground) polygon(data, "#666", null, [4, 3]);
    seen.forEach((data, i) => polygon(data, ["#1c5fa8", "#b35a10"][i], ["rgba(28,95,168,.14)", "rgba(179,90,16,.10)"][i], []));
    context.restore();
  }
}
