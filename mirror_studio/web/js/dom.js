// Elements out of tags, attributes and children.

export function el(tag, attributes = {}, ...children) {
  const element = tag.startsWith("svg:") ? document.createElementNS("http://www.w3.org/2000/svg", tag.slice(4))
    : document.createElement(tag);
  for (const [key, value] of Object.entries(attributes)) {
    if (value === undefined || value === null || value === false) continue;
    if (key.startsWith("on")) element.addEventListener(key.slice(2), value);
    else if (key in element && typeof value === "boolean") element[key] = value;
    else element.setAttribute(key, value === true ? "" : value);
  }
  element.append(...children.filter((child) => child !== undefined && child !== null));
  return element;
}

export const find = (selector) => document.querySelector(selector);

// Sizes are asked for at every picture: to ask the page itself would make it lay everything out again.
const sizes = new WeakMap();
export function watch(element, resized) {
  sizes.set(element, [element.clientWidth, element.clientHeight]);
  new ResizeObserver(() => {
    sizes.set(element, [element.clientWidth, element.clientHeight]);
    resized();
  }).observe(element);
}
export const sizeOf = (element) => sizes.get(element);

// A canvas as sharp as the screen; returns its context in CSS pixels, its width and height.
export function sharp(canvas) {
  const [width, height] = sizeOf(canvas);
  const ratio = window.devicePixelRatio || 1;
  const w = Math.max(1, Math.round(width * ratio)), h = Math.max(1, Math.round(height * ratio));
  if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
  const context = canvas.getContext("2d", { alpha: false });
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return { context, width, height };
}

// A round step that cuts a range into some parts.
export function roundStep(range, parts) {
  const raw = range / parts;
  const power = 10 ** Math.floor(Math.log10(raw));
  return power * [1, 2, 5, 10].find((m) => m * power >= raw);
}
