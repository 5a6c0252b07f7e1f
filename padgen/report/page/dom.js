// Small helpers that make elements. Text only ever goes in as text, so that no name can become markup.

const SVG = "http://www.w3.org/2000/svg";
// Longer texts lose their middle, as padgen's own sentences do.
const LONGEST = 2000;

function shown(children) {
  return children
    .flat()
    .filter((child) => child !== null && child !== undefined)
    .map((child) => (typeof child === "string" && child.length > LONGEST ? `${child.slice(0, LONGEST / 2)}…${child.slice(-LONGEST / 2)}` : child));
}

function filled(node, attributes, children) {
  for (const [key, value] of Object.entries(attributes || {})) {
    if (value === null || value === undefined || value === false) continue;
    if (key === "on") for (const [name, does] of Object.entries(value)) node.addEventListener(name, does);
    else if (key === "paint") Object.assign(node.style, value);
    else node.setAttribute(key, value === true ? "" : String(value));
  }
  node.append(...shown(children));
  return node;
}

/** Make an HTML element: `h("p", {class: "soft"}, "text")`; `on` holds listeners, `paint` styles. */
export const h = (tag, attributes, ...children) => filled(document.createElement(tag), attributes, children);

/** Make an SVG element. */
export const s = (tag, attributes, ...children) => filled(document.createElementNS(SVG, tag), attributes, children);

export const byId = (id) => document.getElementById(id);

export function put(id, ...children) {
  byId(id).replaceChildren(...shown(children));
}

/** Return the bytes of a base64 text. */
export const decoded = (text) => Uint8Array.from(atob(text), (sign) => sign.charCodeAt(0)).buffer;

/** Return numbers that padgen packed as 32-bit floats. */
export const numbers = (packed) => new Float32Array(decoded(packed.float32));

const raised = (power) => String(power).replace(/./g, (sign) => (sign === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[sign]));

/** Write a power of ten as a label. */
export const powerOfTen = (power) => (power >= -2 && power <= 3 ? num(10 ** power) : `10${raised(power)}`);

/** Write a number with so many significant digits, without trailing zeros. */
export function num(value, digits = 4) {
  if (value === null || value === undefined || !Number.isFinite(Number(value))) return "–";
  const number = Number(value);
  const size = Math.abs(number);
  if (size >= 1e7 || (size > 0 && size < 1e-5)) {
    const [share, power] = number.toExponential(digits - 1).split("e");
    return `${share.replace("-", "−")} × 10${raised(Number(power))}`;
  }
  const text = number === 0 ? "0" : size >= 10 ** digits ? number.toFixed(0) : number.toPrecision(digits);
  const short = text.includes("e") || !text.includes(".") ? text : text.replace(/0+$/, "").replace(/\.$/, "");
  return short.replace(/^-/, "−");
}

export const fixed = (value, digits) =>
  value === null || value === undefined || !Number.isFinite(Number(value)) ? "–" : Number(value).toFixed(digits).replace(/^-/, "−");

// Colour scales that colour-blind readers can tell apart: points of viridis without its palest end, and of cividis.
const VIRIDIS = ["#440154", "#472d7b", "#3b528b", "#2c728e", "#21918c", "#28ae80", "#5ec962", "#addc30"];
const HEAT = ["#00224e", "#213b6e", "#4c556c", "#6c6e72", "#8e8978", "#b1a570", "#d9c55c", "#fee838"];

export function scaled(share, from = VIRIDIS) {
  const at = Math.min(Math.max(share, 0), 1) * (from.length - 1);
  const k = Math.min(Math.floor(at), from.length - 2);
  const mix = at - k;
  const part = (colour, i) => parseInt(colour.slice(1 + 2 * i, 3 + 2 * i), 16);
  const parts = [0, 1, 2].map((i) => Math.round(part(from[k], i) * (1 - mix) + part(from[k + 1], i) * mix));
  return `#${parts.map((value) => value.toString(16).padStart(2, "0")).join("")}`;
}

export const heat = (share) => scaled(share, HEAT);

/** Return black or white, whichever reads better on a colour. */
export function inkOn(colour) {
  const [red, green, blue] = [1, 3, 5].map((i) => parseInt(colour.slice(i, i + 2), 16) / 255).map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4));
  return 0.2126 * red + 0.7152 * green + 0.0722 * blue > 0.179 ? "#000" : "#fff";
}
