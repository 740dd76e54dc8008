// A share from 0 to 1 in, a colour out: scales that colour-blind people can read, and that stay ordered in grey.

const rgb = (text) => [1, 3, 5].map((i) => parseInt(text.slice(i, i + 2), 16));

// Viridis (van der Walt and Smith), nine of its colours; and blue to orange through a light grey.
const STOPS = {
  sequential: ["#440154", "#472d7b", "#3b528b", "#2c728e", "#21918c", "#28ae80", "#5ec962", "#addc30", "#fde725"].map(rgb),
  diverging: ["#1c3f84", "#2f69ad", "#6ba0cf", "#b4cfe4", "#efefec", "#f3cfa0", "#e79c4c", "#c4691c", "#8a3f08"].map(rgb),
};

export function table(kind) {
  const stops = STOPS[kind];
  const colours = new Uint8Array(256 * 3);
  for (let i = 0; i < 256; i++) {
    const at = (i / 255) * (stops.length - 1);
    const k = Math.min(Math.floor(at), stops.length - 2);
    for (let c = 0; c < 3; c++) colours[3 * i + c] = Math.round(stops[k][c] + (at - k) * (stops[k + 1][c] - stops[k][c]));
  }
  return colours;
}

export const TABLES = { sequential: table("sequential"), diverging: table("diverging") };

export function css(kind) {
  return `linear-gradient(to right, ${STOPS[kind].map((c) => `rgb(${c.join(",")})`).join(",")})`;
}

// Quantities that a map can show: from the arrays of an answer, with the scale's ends and their labels.
const mm = (perM) => (Math.abs(perM) < 1e-4 ? "flat" : `${Math.round(1000 / perM)}`);
const percent = (v) => `${v.toFixed(Math.abs(v) < 10 ? 2 : 0)}`;
export const QUANTITIES = {
  rx: { label: "Radius Rx", unit: "mm", scale: "sequential", of: (a) => a.kx.data, tick: mm },
  ry: { label: "Radius Ry", unit: "mm", scale: "sequential", of: (a) => a.ky.data, tick: mm },
  ka: { label: "Ka = (1/Rx − 1/Ry)/2", unit: "1/m", scale: "diverging", of: (a) => a.kx.data.map((v, i) => 0.5 * (v - a.ky.data[i])),
    tick: (v) => v.toFixed(3) },
  k1: { label: "Deviation of k₁", unit: "%", scale: "diverging", of: (a) => a.k1_percent.data, tick: percent },
  k2: { label: "Deviation of k₂", unit: "%", scale: "diverging", of: (a) => a.k2_percent.data, tick: percent },
};

const UNKNOWN = [212, 212, 208]; // grey: not known, which no colour of a scale says

// A quantity's field as colours.   cells: whether its values are those of cells, and not of places on the box's edges and between.
// shares: 0 to 255 along the scale, −1 where the value is not known.
export function coloured(quantity, arrays) {
  const { of, scale, cells } = QUANTITIES[quantity];
  const values = of(arrays), stands = cells && arrays.measured_stands.data;
  let low = Infinity, high = -Infinity;
  // What stands at the rim, where the gauge does not, is less sure and sets no scale.
  const sets = stands?.includes(1) ? (i) => stands[i] === 1 : () => true;
  for (let i = 0; i < values.length; i++) if (Number.isFinite(values[i]) && sets(i)) { low = Math.min(low, values[i]); high = Math.max(high, values[i]); }
  if (cells && scale === "sequential") low = 0;
  if (!(low <= high)) [low, high] = [0, 0];
  if (scale === "diverging") { high = Math.max(Math.abs(low), Math.abs(high)); low = -high; }
  // What differs by rounding alone is one colour.
  const size = Math.max(Math.abs(low), Math.abs(high));
  const flat = high - low < 1e-4 * size || size < 1e-6;
  const shares = new Int16Array(values.length), table = TABLES[scale];
  for (let i = 0; i < values.length; i++) {
    if (cells && !Number.isFinite(values[i])) shares[i] = -1;
    else if (flat || !Number.isFinite(values[i])) shares[i] = 128;
    else shares[i] = Math.max(0, Math.min(255, Math.round((255 * (values[i] - low)) / (high - low))));
  }
  const rgb = (share) => (share < 0 ? UNKNOWN : table.subarray(3 * share, 3 * share + 3));
  return { shares, low, high, flat, rgb, cells };
}
