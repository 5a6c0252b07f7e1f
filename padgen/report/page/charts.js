// Axes of charts: how wide they are, and what is marked on them.

import { num, powerOfTen } from "./dom.js";

// Charts are drawn as wide as the page lets them be, so that their text keeps its size on a phone.
let WIDE = 720;
export const wide = () => WIDE;
export const fitCharts = () => (WIDE = Math.min(720, Math.max(320, document.documentElement.clientWidth - 60)));

/** Return round numbers between two values for an axis, so many at most. */
export function ticks(low, high, most = 7) {
  const rough = (high - low) / most || 1;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((n) => n * power).find((n) => n >= rough);
  const found = [];
  for (let at = Math.ceil(low / step - 1e-9) * step; at <= high + 1e-9 * step; at += step) found.push(Number(at.toPrecision(12)));
  return found;
}

/** Tell whether a logarithmic axis reaches so far that whole decades alone are marked. */
const isWide = (low, high) => high > 1e3 * low;

/** Write a value of a logarithmic axis. */
export const logLabel = (scale, value) => (isWide(scale.low, scale.high) ? powerOfTen(Math.round(Math.log10(value))) : num(value));

/** Return round values for a logarithmic axis. */
export function logTicks(low, high) {
  const found = [];
  for (let power = Math.floor(Math.log10(low)); power <= Math.ceil(Math.log10(high)); power++)
    for (const n of [1, 1.5, 2, 3, 4, 5, 6, 8]) found.push(Number((n * 10 ** power).toPrecision(3)));
  const inside = found.filter((hz) => hz >= low && hz <= high);
  if (isWide(low, high)) {
    const powers = inside.filter((value) => Number.isInteger(Math.log10(value)));
    return powers.filter((_, k) => k % Math.ceil(powers.length / 8) === 0);
  }
  return inside.length > 9 ? inside.filter((hz) => /^[125]/.test(String(hz).replace(/^[0.]+/, "")) && !/^15/.test(String(hz))) : inside;
}
