// Numbers in, words out.

export const FLAT = 2e-5; // 1/m: a radius of 50 km
export const MOST_ROWS = 60; // of a table that is edited on the page: a longer one is edited as a file

// With a true minus, and no sign before nothing.
export const fixed = (value, digits) => value.toFixed(digits).replace("-", "−").replace(/^−(0(\.0*)?)$/, "$1");

export const signed = (value) => String(value).replace("-", "−");

export const between = (least, most, unit) => `${signed(least)} to ${signed(most)}${unit === "°" ? "°" : unit && ` ${unit}`}`;
