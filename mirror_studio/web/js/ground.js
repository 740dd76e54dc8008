// The ground that a mirror shows, in plan, the vehicle's front to the right: drawn on a canvas.

import { roundStep, sharp } from "./dom.js";

const REACH = [-6, 42]; // X, m behind the eyes
const LEAST_ASIDE = 10, MOST_ASIDE = 24.5; // m, from the vehicle's middle outwards; the ground is looked at up to 25
const LEFT = "#1c5fa8", RIGHT = "#b35a10";

export function drawGround(canvas, { road, arrays, box_mm }, pinned) {
  const { context, width, height } = sharp(canvas);
  context.fillStyle = "#fff";
  context.fillRect(0, 0, width, height);
  const { road_m: edges, lines, own_m: own, bodies } = road.surroundings;
  // As wide as there is room for; then as far beside the vehicle as that leaves.
  const pad = { left: 27, right: 6, top: 4, bottom: 15 };
  const rows = height - pad.top - pad.bottom, inner = road.hand === "left" ? Math.max(own[3] + 1, edges?.[1] ?? 0) : Math.max(1 - own[2], 5.5);
  const scale = Math.min((width - pad.left - pad.right) / (REACH[1] - REACH[0]), rows / (inner + LEAST_ASIDE));
  const outer = Math.min(MOST_ASIDE, rows / scale - inner);
  const [low, high] = road.hand === "left" ? [-outer, inner] : [-inner, outer];
  const across = (REACH[1] - REACH[0]) * scale, up = (high - low) * scale;
  const left = pad.left + 0.5 * (width - pad.left - pad.right - across), top = pad.top + 0.5 * (height - pad.top - pad.bottom - up);
  const px = (x) => left + (REACH[1] - x) * scale, py = (y) => top + (y - low) * scale;

  context.font = "10px system-ui, sans-serif";
  context.fillStyle = "#667";
  context.textAlign = "center";
  const step = roundStep(REACH[1] - REACH[0], Math.max(2, across / 45));
  for (let x = Math.ceil(REACH[0] / step) * step; x <= REACH[1]; x += step) context.fillText(`${x}`.replace("-", "−"), px(x), top + up + 11);
  context.textAlign = "right";
  for (let y = Math.ceil(low / 5) * 5; y <= high; y += 5) context.fillText(`${y}`.replace("-", "−"), left - 3, py(y) + 3);

  context.save();
  context.beginPath();
  context.rect(left, top, across, up);
  context.clip();
  context.fillStyle = "#e9eee2";
  context.fillRect(left, top, across, up);
  if (edges) {
    context.fillStyle = "#dadde1";
    context.fillRect(left, py(edges[0]), across, (edges[1] - edges[0]) * scale);
  }
  for (const { y_m: y, yellow, dash_m: dash } of lines) {
    context.strokeStyle = yellow ? "#d9a400" : "#fff";
    context.lineWidth = Math.max(1.2, 0.15 * scale);
    context.setLineDash(dash ? [dash[0] * scale, (dash[1] - dash[0]) * scale] : []);
    line(context, [[px(0), py(y)], [px(REACH[1]), py(y)]]);
    context.lineDashOffset = dash ? (dash[0] - dash[1]) * scale : 0; // ahead of X = 0 the dashes run on
    line(context, [[px(0), py(y)], [px(REACH[0]), py(y)]]);
    context.lineDashOffset = 0;
  }
  context.setLineDash([]);
  const outline = ({ data }, closed) => {
    context.beginPath();
    let on = false;
    for (let i = 0; i < data.length; i += 2) {
      if (!Number.isFinite(data[i])) { if (on && closed) context.closePath(); on = false; continue; }
      if (on) context.lineTo(px(data[i]), py(data[i + 1])); else context.moveTo(px(data[i]), py(data[i + 1]));
      on = true;
    }
  };
  outline(arrays.seen_both, true);
  context.fillStyle = "rgba(28,95,168,.26)";
  context.fill();
  context.lineWidth = 1.5;
  for (const [name, colour] of [["seen_left", LEFT], ["seen_right", RIGHT]]) {
    outline(arrays[name], false);
    context.strokeStyle = colour;
    context.stroke();
  }
  if (pinned) {
    context.setLineDash([4, 3]);
    context.strokeStyle = "#333";
    context.lineWidth = 1.2;
    for (const name of ["seen_left", "seen_right"]) { outline(pinned[name], false); context.stroke(); }
    context.setLineDash([]);
  }
  // How wide the ground is seen outward of the flank, at some distances.
  const outward = road.hand === "left" ? -1 : 1, flank = road.hand === "left" ? own[2] : own[3];
  context.strokeStyle = "rgba(29,35,43,.55)";
  context.lineWidth = 1;
  for (const [x, wide] of road.figures.seen_width_m) if (wide > 0) line(context, [[px(x), py(flank)], [px(x), py(flank + outward * wide)]]);
  for (const { name, corners_m: corners } of bodies) {
    polygon(context, corners.map(([x, y]) => [px(x), py(y)]), "#c3cad1", "#5b6670");
  }
  names(context, bodies.map(({ name, corners_m: corners }) => [name, around(corners.map(([x, y]) => [px(x), py(y)]))]),
    around([[px(own[0]), py(own[2])], [px(own[1]), py(own[3])]]), [left, top, left + across, top + up]);
  polygon(context, [[own[0], own[2]], [own[1], own[2]], [own[1], own[3]], [own[0], own[3]]].map(([x, y]) => [px(x), py(y)]), "#fff", "#1d232b");
  road.eyes_m.forEach(([x, y], i) => {
    context.fillStyle = i ? RIGHT : LEFT;
    context.beginPath();
    context.arc(px(x), py(y), 2, 0, 2 * Math.PI);
    context.fill();
  });
  const [x, y] = road.mirror_m, half = 5e-4 * (box_mm[1] - box_mm[0]);
  context.strokeStyle = "#1d232b";
  context.lineWidth = 2;
  line(context, [[px(x), py(y - half)], [px(x), py(y + half)]]);
  context.restore();
}

// The box about places: left, top, right, bottom.
const around = (points) => [Math.min, Math.max].flatMap((most) => [0, 1].map((c) => most(...points.map((point) => point[c]))));
const apart = (a, b) => a[2] <= b[0] || b[2] <= a[0] || a[3] <= b[1] || b[3] <= a[1];

// Each vehicle's name on it or beside it, where that covers nothing else.
function names(context, named, own, frame) {
  const taken = [...named.map(([, box]) => box), own];
  context.fillStyle = "#1d232b";
  context.textAlign = "center";
  for (const [name, box] of named) {
    const wide = context.measureText(name).width + 4, tall = 11, x = 0.5 * (box[0] + box[2]), y = 0.5 * (box[1] + box[3]);
    const at = (cx, cy) => [cx - wide / 2, cy - tall / 2, cx + wide / 2, cy + tall / 2];
    const beside = [at(x, box[1] - tall / 2 - 1), at(x, box[3] + tall / 2 + 1), at(box[0] - wide / 2, y), at(box[2] + wide / 2, y)];
    const spot = wide - 4 < box[2] - box[0] ? at(x, y) : beside.find((one) => one[0] >= frame[0] && one[1] >= frame[1] && one[2] <= frame[2]
      && one[3] <= frame[3] && taken.every((other) => apart(one, other)));
    if (!spot) continue;
    taken.push(spot);
    context.fillText(name, 0.5 * (spot[0] + spot[2]), spot[3] - 2.5);
  }
}

function line(context, points) {
  context.beginPath();
  for (const [x, y] of points) context.lineTo(x, y);
  context.stroke();
}

function polygon(context, points, fill, stroke) {
  context.beginPath();
  for (const [x, y] of points) context.lineTo(x, y);
  context.closePath();
  context.fillStyle = fill;
  context.fill();
  context.strokeStyle = stroke;
  context.lineWidth = 1;
  context.stroke();
}
