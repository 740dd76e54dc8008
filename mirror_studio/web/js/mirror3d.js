// The mirror in three dimensions: coloured by a quantity, with reflection lines and section combs. Drawn when there is time.

import { BufferAttribute, BufferGeometry, Color, DoubleSide, LineBasicMaterial, LineLoop, LineSegments, Mesh, PerspectiveCamera, Scene,
  ShaderMaterial, WebGLRenderer } from "three";
import { coloured } from "./colours.js";
import { cellAt } from "./measured.js";
import { sizeOf, watch } from "./dom.js";

const AROUND = 144, RINGS = 22; // corners of the mesh along the outline, and rings between it and the middle
const COMB_PLACES = 41;

const VERTEX = `
attribute vec3 tint; varying vec3 vTint; varying vec3 vNormal; varying vec3 vPlace;
void main() { vTint = tint; vNormal = normalize(normalMatrix * normal); vec4 p = modelViewMatrix * vec4(position, 1.0); vPlace = p.xyz; gl_Position = projectionMatrix * p; }`;
const FRAGMENT = `
varying vec3 vTint; varying vec3 vNormal; varying vec3 vPlace; uniform float lines;
void main() {
  vec3 n = normalize(vNormal) * (gl_FrontFacing ? 1.0 : -1.0);
  float light = 0.62 + 0.38 * max(dot(n, normalize(vec3(0.35, 0.55, 0.75))), 0.0);
  vec3 colour = gl_FrontFacing ? vTint : vec3(0.5);
  vec3 r = reflect(normalize(vPlace), n);
  float s = 14.0 * r.x / (1.0 + abs(r.z)), w = fwidth(s);
  float stripe = smoothstep(0.25 - w, 0.25 + w, abs(fract(s) - 0.5));
  colour = mix(colour, colour * 0.22, lines * stripe);
  gl_FragColor = vec4(colour * light, 1.0);
  #include <colorspace_fragment>
}`;

export class Mirror3D {
  constructor(canvas) {
    this.canvas = canvas;
    this.turn = { yaw: -0.7, pitch: 0.3, far: 1 };
    this.combs = true;
    this.lines = false;
    this.waiting = false;
    try {
      this.renderer = new WebGLRenderer({ canvas, antialias: true, powerPreference: "low-power" });
    } catch {
      return; // no WebGL: the flat map stays
    }
    this.renderer.setClearColor(new Color("#f4f5f7"));
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(24, 1, 1, 1e5);
    this.material = new ShaderMaterial({ vertexShader: VERTEX, fragmentShader: FRAGMENT, side: DoubleSide, uniforms: { lines: { value: 0 } } });
    this.mesh = new Mesh(new BufferGeometry(), this.material);
    this.rim = new LineLoop(new BufferGeometry(), new LineBasicMaterial({ color: "#444" }));
    this.comb = [["#1c5fa8"], ["#b35a10"]].map(([color]) => new LineSegments(new BufferGeometry(), new LineBasicMaterial({ color })));
    this.scene.add(this.mesh, this.rim, ...this.comb);
    this.controls();
    watch(canvas, () => this.later());
  }

  controls() {
    const { canvas, turn } = this;
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      let [x, y] = [event.clientX, event.clientY];
      const move = (e) => {
        turn.yaw += 0.008 * (e.clientX - x);
        turn.pitch = Math.max(-1.5, Math.min(1.5, turn.pitch + 0.008 * (e.clientY - y)));
        [x, y] = [e.clientX, e.clientY];
        this.later();
      };
      canvas.addEventListener("pointermove", move);
      canvas.addEventListener("pointerup", () => canvas.removeEventListener("pointermove", move), { once: true });
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      turn.far = Math.max(0.3, Math.min(4, turn.far * Math.exp(0.001 * event.deltaY)));
      this.later();
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: ["yaw", -0.1], ArrowRight: ["yaw", 0.1], ArrowUp: ["pitch", 0.1], ArrowDown: ["pitch", -0.1] }[event.key];
      if (step) turn[step[0]] += step[1];
      else if (event.key === "+" || event.key === "-") turn.far *= event.key === "-" ? 1.1 : 0.9;
      else if (event.key === "Home") Object.assign(turn, { yaw: -0.7, pitch: 0.3, far: 1 });
      else return;
      event.preventDefault();
      this.later();
    });
    canvas.addEventListener("dblclick", () => { Object.assign(turn, { yaw: -0.7, pitch: 0.3, far: 1 }); this.later(); });
  }

  show(answer, quantity) {
    this.answer = answer;
    this.quantity = quantity;
    this.stale = true;
    this.later();
  }

  // Software rendering takes the time that the next picture needs: it waits until nothing else is due.
  later() {
    if (this.waiting || !this.renderer) return;
    this.waiting = true;
    const draw = () => {
      if (this.busy?.()) { setTimeout(draw, 60); return; }
      this.waiting = false;
      this.draw();
    };
    (window.requestIdleCallback ?? setTimeout)(draw, { timeout: 400 });
  }

  draw() {
    if (!this.answer) return;
    if (this.stale) this.build();
    const { canvas, camera, renderer, turn } = this;
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const [width, height] = sizeOf(canvas);
    if (!width || !height) return;
    renderer.setPixelRatio(ratio);
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    const [x0, x1, y0, y1] = this.answer.box_mm;
    const size = 0.5 * Math.hypot(x1 - x0, y1 - y0) * 0.98;
    const far = (turn.far * size) / Math.sin((0.5 * camera.fov * Math.PI) / 180) / Math.min(1, camera.aspect * 1.4);
    const target = [0.5 * (x0 + x1), 0.5 * (y0 + y1), this.middle];
    camera.position.set(target[0] + far * Math.sin(turn.yaw) * Math.cos(turn.pitch), target[1] + far * Math.sin(turn.pitch),
      target[2] + far * Math.cos(turn.yaw) * Math.cos(turn.pitch));
    camera.near = far / 50;
    camera.far = far * 4;
    camera.lookAt(...target);
    camera.updateProjectionMatrix();
    this.material.uniforms.lines.value = this.lines ? 1 : 0;
    for (const comb of this.comb) comb.visible = this.combs;
    renderer.render(this.scene, camera);
    canvas.dataset.drawn = String(this.answer.id);
  }

  build() {
    this.stale = false;
    const { arrays, box_mm: [x0, x1, y0, y1] } = this.answer;
    const [nx, ny] = arrays.z.shape, z = arrays.z.data;
    const { shares, rgb, cells } = coloured(this.quantity, arrays);
    const at = (values, x, y) => {
      const u = Math.min(nx - 1.0001, Math.max(0, ((x - x0) / (x1 - x0)) * (nx - 1))), v = Math.min(ny - 1.0001, Math.max(0, ((y - y0) / (y1 - y0)) * (ny - 1)));
      const i = Math.floor(u), j = Math.floor(v), a = u - i, b = v - j, k = i * ny + j;
      return (1 - a) * ((1 - b) * values[k] + b * values[k + 1]) + a * ((1 - b) * values[k + ny] + b * values[k + ny + 1]);
    };
    const dx = (x1 - x0) / (nx - 1), dy = (y1 - y0) / (ny - 1);
    // Slopes at the places of the grid, to be interpolated like the heights.
    const zx = new Float32Array(z.length), zy = new Float32Array(z.length);
    for (let i = 0; i < nx; i++) {
      for (let j = 0; j < ny; j++) {
        const i0 = Math.max(i - 1, 0), i1 = Math.min(i + 1, nx - 1), j0 = Math.max(j - 1, 0), j1 = Math.min(j + 1, ny - 1), k = i * ny + j;
        zx[k] = (z[i1 * ny + j] - z[i0 * ny + j]) / ((i1 - i0) * dx);
        zy[k] = (z[i * ny + j1] - z[i * ny + j0]) / ((j1 - j0) * dy);
      }
    }
    // Of cells, those that a place lies in; else between the places of the grid.
    const share = cells ? (x, y) => shares[cellAt(this.answer, x, y)] : (x, y) => Math.round(at(shares, x, y));
    const ring = resampled(arrays.outline.data, AROUND), cx = 0.5 * (x0 + x1), cy = 0.5 * (y0 + y1);
    const count = AROUND * RINGS + 1;
    const place = new Float32Array(3 * count), normal = new Float32Array(3 * count), tint = new Float32Array(3 * count);
    const set = (n, x, y) => {
      place.set([x, y, at(z, x, y)], 3 * n);
      const p = at(zx, x, y), q = at(zy, x, y), size = Math.hypot(p, q, 1);
      normal.set([-p / size, -q / size, 1 / size], 3 * n);
      const colour = rgb(share(x, y));
      for (let c = 0; c < 3; c++) tint[3 * n + c] = linear(colour[c]);
    };
    set(count - 1, cx, cy);
    const index = [];
    for (let r = 0; r < RINGS; r++) {
      const share = (r + 1) / RINGS;
      for (let a = 0; a < AROUND; a++) {
        const b = (a + 1) % AROUND;
        set(r * AROUND + a, cx + share * (ring[2 * a] - cx), cy + share * (ring[2 * a + 1] - cy));
        if (r === 0) index.push(count - 1, a, b);
        else index.push((r - 1) * AROUND + a, r * AROUND + a, r * AROUND + b, (r - 1) * AROUND + a, r * AROUND + b, (r - 1) * AROUND + b);
      }
    }
    const { geometry } = this.mesh;
    geometry.setAttribute("position", new BufferAttribute(place, 3));
    geometry.setAttribute("normal", new BufferAttribute(normal, 3));
    geometry.setAttribute("tint", new BufferAttribute(tint, 3));
    geometry.setIndex(index);
    geometry.boundingSphere = null;
    this.rim.geometry.setAttribute("position", new BufferAttribute(place.slice(3 * (RINGS - 1) * AROUND, 3 * RINGS * AROUND), 3));
    this.rim.geometry.boundingSphere = null;
    this.middle = at(z, cx, cy) - 0.5 * (at(z, cx, cy) - Math.min(at(z, x0, cy), at(z, x1, cy)));
    // Combs: the normal curvature along the two middle lines, as teeth on the surface.
    const size = Math.max(...arrays.kx.data.map(Math.abs), ...arrays.ky.data.map(Math.abs)) || 1;
    const tooth = (0.28 * Math.min(x1 - x0, y1 - y0)) / size;
    [arrays.kx.data, arrays.ky.data].forEach((kappa, axis) => {
      const tips = [], lines = [];
      for (let s = 0; s < COMB_PLACES; s++) {
        const share = s / (COMB_PLACES - 1);
        const x = axis ? cx : x0 + share * (x1 - x0), y = axis ? y0 + share * (y1 - y0) : cy;
        const k = at(kappa, x, y), p = at(zx, x, y), q = at(zy, x, y), n = Math.hypot(p, q, 1);
        const foot = [x, y, at(z, x, y)], tip = [foot[0] - (tooth * k * p) / n, foot[1] - (tooth * k * q) / n, foot[2] + (tooth * k) / n];
        lines.push(...foot, ...tip);
        if (s) lines.push(...tips.at(-1), ...tip);
        tips.push(tip);
      }
      this.comb[axis].geometry.setAttribute("position", new BufferAttribute(new Float32Array(lines), 3));
      this.comb[axis].geometry.boundingSphere = null;
    });
  }
}

const linear = (v) => (v / 255 <= 0.04045 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4);

// So many points on a closed polygon, equally far apart along it.
function resampled(data, count) {
  const n = data.length / 2, along = [0];
  for (let i = 1; i <= n; i++) along.push(along[i - 1] + Math.hypot(data[2 * (i % n)] - data[2 * i - 2], data[2 * (i % n) + 1] - data[2 * i - 1]));
  const result = new Float64Array(2 * count);
  for (let a = 0, i = 0; a < count; a++) {
    const target = (a / count) * along[n];
    while (along[i + 1] < target) i++;
    const share = (target - along[i]) / (along[i + 1] - along[i] || 1), j = (i + 1) % n;
    for (const c of [0, 1]) result[2 * a + c] = data[2 * i + c] + share * (data[2 * j + c] - data[2 * i + c]);
  }
  return result;
}
