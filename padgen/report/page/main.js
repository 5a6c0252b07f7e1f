// The page: renders everything from one table of data, `window.padgen.show(data)`, without reloading.

import { byId, fixed, h, heat, num, put, s, scaled } from "./dom.js";
import { fitCharts } from "./charts.js";
import { showFigure } from "./figures.js";
import { manual } from "./manual.js";
import { at, framesOf, movedBy } from "./motion.js";
import { study } from "./study.js";
import { facts, jump, table, unprinted } from "./tables.js";
import { makeView } from "./view.js";

const SHOWN_MM = 0.35; // the largest motion, over the pad's thickness, as it is drawn
const FRAME_S = 0.9; // seconds that a frame of a sequence is shown
const SLOWED = [10, 20, 50, 100, 200, 500];
const CHARTS = [...document.querySelectorAll("section[data-figure]")].map((section) => section.id);

let data = null;
let view = null;
const state = { selected: null, bits: "1", sequence: "", colour: "channel", explode: 0, section: 0, playing: false, slowed: 50 };
let frame = null; // {motions: per taxel {level_um, tones}, on: Set}
const inView = () => view?.shows(data); // else its parts still are an older plan's

// The view ---------------------------------------------------------------------------------------------------------

function makeOnce() {
  try {
    view = makeView(byId("canvas"), { picked: (index) => select(data.taxels.id[index]), drawn: labels });
  } catch {
    byId("no-3d").hidden = false;
    byId("canvas").hidden = true;
  }
  put("contents", [...document.querySelectorAll("main section[id] > h2")].map((title) => h("a", { href: `#${title.parentElement.id}` }, title.textContent)));
  byId("colour").addEventListener("change", (event) => ((state.colour = event.target.value), paint()));
  for (const name of ["explode", "section"])
    byId(name).addEventListener("input", (event) => {
      state[name] = Number(event.target.value) / 100;
      view?.[name](state[name]);
      if (name === "explode") {
        view?.fit();
        marks();
      }
    });
  for (const button of document.querySelectorAll("[data-look]")) button.addEventListener("click", () => {
      // From below, coils and tray would hide all that there is to see.
      if (button.dataset.look === "below") showParts("pad");
      view?.look(button.dataset.look);
    });
  byId("parts").addEventListener("change", (event) => showParts(event.target.value));
  byId("taxel-close").addEventListener("click", () => (select(null), byId("canvas").focus()));
  byId("canvas").addEventListener("keydown", keys);
  byId("state").addEventListener("input", (event) => setState(event.target.value));
  byId("sequence").addEventListener("change", (event) => ((state.sequence = event.target.value), setState(state.bits)));
  put("slow", SLOWED.map((n) => h("option", { value: n, selected: n === state.slowed }, `${n} times`)));
  byId("slow").addEventListener("change", (event) => ((state.slowed = Number(event.target.value)), explained()));
  byId("play").addEventListener("click", () => play(!state.playing));
  for (const name of CHARTS) byId(`${name}-which`).addEventListener("change", () => showFigure(data, name));
  byId("print-manual").addEventListener("click", () => {
    document.body.dataset.print = "manual";
    window.print();
    delete document.body.dataset.print;
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => CHARTS.forEach((name) => showFigure(data, name)));
  window.addEventListener("beforeprint", () => {
    if (document.body.dataset.print) takePictures();
    view?.drawNow();
  });
  new IntersectionObserver((entries) => {
    manualNear = entries[entries.length - 1].isIntersecting;
    if (manualNear) takePictures();
  }, { rootMargin: "400px" }).observe(byId("manual"));
}

const BELOW = ["copper", "iron", "tray", "board"];
function showParts(which) {
  byId("parts").value = which;
  view?.hide({ all: [], coils: ["tray", "guard"], pad: [...BELOW, "guard"] }[which]);
}

function keys(event) {
  const steps = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] };
  if (event.key === "Escape") select(null);
  else if (event.key === "+" || event.key === "=") view?.zoom(0.85);
  else if (event.key === "-") view?.zoom(1 / 0.85);
  else if (steps[event.key]) select(data.taxels.id[beside(steps[event.key])]);
  else return;
  event.preventDefault();
}

/** Return the taxel next to the chosen one in a direction of the frame's pixels. */
function beside([down, right]) {
  const { pixel } = data.taxels;
  const now = data.index.get(state.selected);
  if (now === undefined) return 0;
  const [row, column] = pixel[now];
  let best = now;
  let least = Infinity;
  pixel.forEach(([r, c], index) => {
    const [dr, dc] = [r - row, c - column];
    const ahead = dr * down + dc * right;
    const aside = Math.abs(dr * right) + Math.abs(dc * down);
    const far = ahead + 2.5 * aside;
    if (ahead > 0 && far < least) [best, least] = [index, far];
  });
  return best;
}

const MODES = {
  channel: { title: "Channel", of: (i) => data.colours[data.taxels.channel[i]] },
  print: {
    title: "Prints in which the taxel's coil keeps what is asked",
    value: (i) => data.coils.print_shares[data.taxels.coil[i]],
    told: (v) => `${num(100 * v, 3)} %`,
    range: () => [0, 1],
    scale: (share) => scaled(share),
  },
  leak: { title: "Leak of the coils around, below its own level, at its channel's worst place", value: (i) => data.channels[data.taxels.channel[i]].leak_db, told: (v) => `${fixed(v, 1)} dB`, scale: heat },
  stress: { title: "Stress at the beam's root at full level", value: (i) => data.channels[data.taxels.channel[i]].root_stress_mpa, told: (v) => `${num(v, 3)} MPa`, scale: heat },
};

function paint() {
  const mode = MODES[state.colour];
  const every = data.taxels.id.map((_, index) => index);
  if (!mode.value) {
    const shown = data.channels.length <= 12 ? data.channels : [data.channels[0], data.channels[data.channels.length - 1]];
    put("legend", h("strong", {}, mode.title), shown.map((channel) => h("span", {}, h("i", { paint: { background: data.colours[channel.index] } }), `${channel.index}: ${fixed(channel.resonance_hz, 0)} Hz`)));
    if (inView()) view.colours(mode.of);
    return;
  }
  const values = every.map(mode.value);
  const known = values.filter((value) => value !== null);
  const [low, high] = mode.range ? mode.range() : [Math.min(...known), Math.max(...known)];
  const share = (value) => (high > low ? (value - low) / (high - low) : 0.5);
  const ends = high > low ? [low, (low + high) / 2, high] : [low];
  put("legend", h("strong", {}, mode.title), known.length ? ends.map((value) => h("span", {}, h("i", { paint: { background: mode.scale(share(value)) } }), mode.told(value))) : h("span", {}, "nothing leaks"));
  if (inView()) view.colours((i) => (values[i] === null ? "#bbbbbb" : mode.scale(share(values[i]))));
}

const LABEL_PX = { width: 62, height: 20 };

/** Name the parts that the cut goes through, in a column at the right edge with a line to each. */
function labels() {
  const parts = view?.cutParts() ?? [];
  const { clientWidth: wide, clientHeight: high } = byId("canvas");
  const seen = parts.filter(([, x, y]) => x >= 0 && x <= wide && y >= 0 && y <= high).sort((a, b) => a[2] - b[2]);
  let low = LABEL_PX.height;
  put("labels", seen.flatMap(([name, x, y]) => {
    const at = Math.max(low, y);
    low = at + LABEL_PX.height;
    const left = wide - LABEL_PX.width;
    return [s("line", { x1: x, y1: y, x2: left - 4, y2: at }), s("circle", { cx: x, cy: y, r: 2.5 }), s("text", { x: left, y: at + 4 }, name)];
  }));
}

// A taxel --------------------------------------------------------------------------------------------------------

let highlighted = [];
const placeOf = (index) => [data.taxels.x_mm[index], data.taxels.y_mm[index]];

function marks() {
  const chosen = data.index.get(state.selected);
  if (inView()) view.mark([...(chosen === undefined ? [] : [placeOf(chosen)]), ...highlighted]);
}

function select(id) {
  const index = data.index.get(id);
  state.selected = index === undefined ? null : id;
  highlighted = [];
  byId("taxel").hidden = index === undefined;
  put("taxel-told");
  if (index !== undefined) {
    const pairs = about(index);
    put("taxel-name", id);
    put("taxel-figures", facts(pairs));
    put("taxel-told", `Taxel ${id}: ${pairs.map(([name, value]) => `${name} ${value}`).join(", ")}`);
  }
  marks();
  document.dispatchEvent(new CustomEvent("padgen-select", { detail: state.selected }));
}

function about(index) {
  const { taxels, coils, channels } = data;
  const channel = channels[taxels.channel[index]];
  const coil = taxels.coil[index];
  const [row, column] = taxels.pixel[index];
  const pairs = [
    ["channel", `${channel.index} of coil ${coil + 1}`],
    ["resonance", `${fixed(channel.resonance_hz, 2)} Hz`],
    ["driven at", `${fixed(channel.drive_hz, 2)} Hz`],
    ["beam", `${channel.beam} mm, ${channel.suspension}`],
    ["level", `${fixed(channel.level_um, 2)} µm peak`],
    ["print share", `${num(100 * coils.print_shares[coil], 3)} %`],
    ["frame", `row ${row + 1}, column ${column + 1}`],
    ["place", `${fixed(taxels.x_mm[index], 2)}, ${fixed(taxels.y_mm[index], 2)} mm`],
  ];
  if (frame) pairs.push(["now", `${num(frame.motions[index].level_um, 3)} µm${frame.on.has(index) ? " (on)" : " (off)"}`]);
  return pairs;
}

// Motion -----------------------------------------------------------------------------------------------------------

/** Return what all taxels do while those of `on`, by index, are on. */
function motionsWith(on) {
  const { taxels, motion } = data;
  const motions = new Array(taxels.id.length);
  const members = new Map();
  taxels.coil.forEach((coil, index) => (members.get(coil) || members.set(coil, []).get(coil)).push(index));
  const known = new Map();
  for (const [coil, own] of members) {
    const which = motion.set_of_coil[coil];
    const position = (index) => motion.sets[which].channels.indexOf(taxels.channel[index]);
    const playing = own.filter((index) => on.has(index)).map(position).sort((a, b) => a - b);
    const key = `${which}:${playing}`;
    if (!known.has(key)) known.set(key, movedBy(data, which, playing));
    for (const index of own) motions[index] = known.get(key)[position(index)];
  }
  return { motions, on };
}

/** Return the taxels that a state's bits switch on, lowest channel of each coil first. */
function onBy(bits) {
  const { taxels, motion } = data;
  return new Set(taxels.id.map((_, index) => index).filter((index) => bits[motion.sets[motion.set_of_coil[taxels.coil[index]]].channels.indexOf(taxels.channel[index])] === "1"));
}

let frames = [];
function setState(text) {
  const most = Math.max(...data.motion.sets.map((set) => set.channels.length));
  const bits = String(text).replace(/[^01]/g, "").slice(0, most).padEnd(most, "0");
  state.bits = bits;
  if (byId("state").value !== text) byId("state").value = bits;
  byId("state").setAttribute("maxlength", most);
  frames = state.sequence ? framesOf(data, state.sequence) : [onBy(bits)];
  frame = motionsWith(frames[0]);
  explained();
  if (!state.playing) still();
  if (state.selected) select(state.selected);
}

function drawnScale() {
  return (SHOWN_MM * data.pad.frame_mm) / Math.max(...data.channels.map((channel) => channel.level_um));
}

function explained() {
  const most = Math.max(...data.motion.sets.map((set) => set.channels.length));
  const times = Number((drawnScale() * 1000).toPrecision(2));
  const spurs = data.motion.sets.some((set) => set.without_spurs) ? " Spurs of so many channels are left out." : "";
  const turns = data.motion.turns ? " Channels of a coil take turns, one after the other." : "";
  byId("state-help").textContent = `${most === 1 ? "A digit" : `${most} digits`}, 1 for on, channel ${data.motion.sets[0].channels[0]} first. Drawn ${num(times)} times larger and ${state.slowed} times slower than it is; amplitudes and phases are true to each other.${turns}${spurs}`;
}

function still() {
  if (inView()) view.lift(new Float32Array(data.taxels.id.length));
}

let began = 0;
function play(on) {
  state.playing = on;
  byId("play").textContent = on ? "Stop" : "Play";
  byId("play").setAttribute("aria-pressed", String(on));
  if (on) {
    began = performance.now();
    requestAnimationFrame(step);
  } else still();
}

function step(now) {
  if (!state.playing) return;
  moveTo((now - began) / 1000);
  requestAnimationFrame(step);
}

/** Return how far each taxel is from its rest towards its coil, in µm, at a time in s; who takes turns, by their number. */
function displaced(seconds, turn) {
  const cache = new Map();
  return frame.motions.map((motion) => {
    if (!cache.has(motion)) {
      const tones = data.motion.turns && motion.tones.length ? [motion.tones[turn % motion.tones.length]] : motion.tones;
      cache.set(motion, at(tones, seconds));
    }
    return cache.get(motion);
  });
}

let shownFrame = 0;
/** Show the motion at a time in s of the page's clock; a coil's pull is downwards. */
function moveTo(seconds) {
  const k = frames.length > 1 ? Math.floor(seconds / FRAME_S) % frames.length : 0;
  if (frames.length > 1 && k !== shownFrame) {
    shownFrame = k;
    frame = motionsWith(frames[k]);
  }
  const scale = drawnScale();
  const heights = Float32Array.from(displaced(seconds / state.slowed, Math.floor(seconds / FRAME_S)), (um) => -scale * um);
  if (inView()) view.lift(heights);
}

// Sections ---------------------------------------------------------------------------------------------------------

function first() {
  const { verdict, pad } = data;
  put("name", data.name);
  put("verdict", h("span", { class: `pill ${verdict.level}` }, verdict.badge), h("span", {}, verdict.sentence));
  for (const name of ["shaken", "touched"]) {
    put(name, verdict[name]);
    byId(name).hidden = !verdict[name];
  }
  put("about", verdict.about);
  put("figures", data.figures.map(({ label, value, note }) => h("div", { class: "figure" }, h("h2", {}, label), h("p", { class: "value" }, value), h("p", { class: "soft" }, note))));
  document.title = `${data.name.slice(0, 120)}: ${num(pad.width_mm)} × ${num(pad.depth_mm)} mm, ${data.taxels.id.length} taxels`;
}

function driverTable() {
  const { drive } = data;
  const columns = drive.columns.map((key, index) => ({ key, name: drive.headings[index][0], unit: drive.headings[index][1] }));
  put("drive-body", table("Driver table", columns, drive.rows.map((row) => row.map((value) => (typeof value === "number" && !Number.isInteger(value) ? { text: num(value, 5), value } : { text: value === null ? "∞" : String(value), value }))), { copy: true, file: "drive.csv" }));
}

function taxelTable() {
  const { taxels, channels } = data;
  const rows = taxels.id.map((id, index) => {
    const channel = channels[taxels.channel[index]];
    const [row, column] = taxels.pixel[index];
    return [id, channel.index, taxels.coil[index] + 1, { text: fixed(channel.resonance_hz, 2), value: channel.resonance_hz }, { text: fixed(channel.level_um, 2), value: channel.level_um }, { text: `${num(100 * data.coils.print_shares[taxels.coil[index]], 3)} %`, value: data.coils.print_shares[taxels.coil[index]] }, { text: `${row + 1}, ${column + 1}`, value: row * 1e4 + column }, { text: fixed(taxels.x_mm[index], 2), value: taxels.x_mm[index] }, { text: fixed(taxels.y_mm[index], 2), value: taxels.y_mm[index] }];
  });
  const heads = [["taxel"], ["channel"], ["coil"], ["resonance", "Hz"], ["level", "µm peak"], ["print share"], ["row, column"], ["x", "mm"], ["y", "mm"]];
  put("taxels-body", table("Taxels", heads.map(([name, unit]) => ({ name, unit })), rows, { copy: true, click: (index) => (select(taxels.id[index]), jump("view")) }));
}

const PRINTED_CHECKS = 6;
const PRINTED_PARTS = 11;
const LEVELS = ["error", "warning", "note"];

function checks() {
  const ordered = [...data.findings].sort((a, b) => LEVELS.indexOf(a.level) - LEVELS.indexOf(b.level));
  const counts = LEVELS.map((level) => [level, ordered.filter((finding) => finding.level === level).length]).filter(([, count]) => count);
  const head = counts.length ? counts.map(([level, count]) => `${count} ${level}${count > 1 ? "s" : ""}`).join(", ") : "Every check holds";
  const measured = data.built ? [["size_mm", "size"], ["triangles", "triangles"], ["smallest_wall_mm", "smallest wall, mm"], ["smallest_gap_mm", "smallest gap, mm"], ["longest_bridge_mm", "longest bridge, mm"], ["largest_difference_from_plan_mm", "largest difference from the plan, mm"]].filter(([key]) => data.checked[key] !== undefined && data.checked[key] !== null) : [];
  put(
    "checks-body",
    h("p", {}, `${head}. ${data.built ? "The plan and the finished mesh were checked." : "The plan was checked; the mesh is measured when the pad is built."}`),
    measured.length ? h("dl", { class: "facts" }, measured.flatMap(([key, name]) => [h("dt", {}, name), h("dd", {}, [].concat(data.checked[key]).map((value) => num(Math.abs(value) < 1e-6 ? 0 : value, Number.isInteger(value) ? 9 : 3)).join(" × "))])) : null,
    unprinted(ordered.filter((finding, index) => index >= PRINTED_CHECKS || finding.level === "note").length, "finding", "report.html"),
    h("ul", { class: "findings" }, ordered.map((finding, index) => {
      const places = placesOf(finding);
      const inner = [h("strong", {}, finding.level), " ", h("span", { class: "where" }, finding.where), `: ${finding.message} `, h("code", {}, finding.code)];
      const show = () => ((highlighted = places), marks(), jump("view"), put("taxel-told", `${places.length} place${places.length > 1 ? "s" : ""} marked: ${finding.where}`));
      return h("li", { class: `${finding.level}${index < PRINTED_CHECKS && finding.level !== "note" ? "" : " beyond"}` }, places.length ? h("button", { type: "button", class: "finding", on: { click: show } }, inner) : inner);
    })),
  );
}

/** Return the places [x, y] in mm that a finding speaks of: taxels, channels, coils or points. */
function placesOf({ where, message }) {
  const { taxels } = data;
  const named = (text) => [...text.matchAll(/r\d+c\d+k\d+/g)].map(([id]) => data.index.get(id)).filter((index) => index !== undefined);
  const of = (chosen) => taxels.id.map((_, index) => index).filter(chosen);
  const point = /\((-?[\d.]+), (-?[\d.]+)(?:, -?[\d.]+)?\) mm/.exec(where);
  if (point) return [[Number(point[1]), Number(point[2])]];
  const ids = named(where);
  if (ids.length) return ids.map(placeOf);
  const channels = /channels? ([\d, and]+)/.exec(where);
  if (channels) {
    const numbers = new Set(channels[1].match(/\d+/g).map(Number));
    return of((index) => numbers.has(taxels.channel[index])).map(placeOf);
  }
  const coil = /coil (\d+), (\d+)/.exec(where) || /coil \(?row (\d+), column (\d+)/.exec(where);
  if (coil) return of((index) => taxels.coil[index] === Number(coil[1]) * data.coils.columns + Number(coil[2])).map(placeOf);
  if (where === "pad" && /print|re-tuned/.test(message)) {
    const worst = Math.min(...data.coils.print_shares);
    return of((index) => data.coils.print_shares[taxels.coil[index]] <= worst + 1e-9).map(placeOf);
  }
  return named(message).map(placeOf);
}

function billOfMaterials() {
  const [head, ...rows] = data.bom;
  const { tray } = data.manual;
  const masses = data.masses_g;
  const high = data.pad.boss_top_mm;
  const stack = tray ? ["height, tray and pad", `${num(tray.height_mm + high, 3)} mm`] : ["height of the pad", `${num(high, 3)} mm`];
  put(
    "bom-body",
    h("dl", { class: "facts" }, facts([["pad without washers", `${data.built ? "" : "about "}${num(masses.plastic, 3)} g`], ["washers", `${num(masses.washers, 3)} g`], ["pad, washers glued", `${num(masses.plastic + masses.washers, 3)} g`], stack])),
    h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Bill of materials" }, h("table", {}, h("thead", {}, h("tr", {}, head.map((name) => h("th", { scope: "col", class: "left" }, name)))), h("tbody", {}, rows.map(([item, quantity, unit, what], index) => h("tr", { class: index < PRINTED_PARTS ? null : "beyond" }, h("th", { scope: "row" }, item), h("td", {}, quantity), h("td", { class: "left" }, unit), h("td", { class: "left" }, what)))))),
    unprinted(rows.length - PRINTED_PARTS, "row", "bom.csv"),
  );
}

function origin() {
  const flat = (value, path) =>
    value !== null && typeof value === "object" && !Array.isArray(value) ? Object.entries(value).flatMap(([key, entry]) => flat(entry, path ? `${path}.${key}` : key)) : value === null ? [] : [[path, Array.isArray(value) ? `[${value.join(", ")}]` : String(value)]];
  put(
    "origin-body",
    h("details", {}, h("summary", {}, "Spec, every field as it was used"), h("dl", { class: "facts" }, facts(flat(data.spec, "")))),
    h("details", {}, h("summary", {}, `Versions: padgen ${data.versions.padgen}`), h("dl", { class: "facts" }, facts(Object.entries(data.versions).map(([name, version]) => [name, String(version)])))),
  );
  put("foot", `padgen ${data.versions.padgen} · ${data.name.slice(0, 80)} · ${data.built ? "shown with the built mesh" : "shown from the plan; padgen build makes the files to print"}`);
}

let pictured = null;
let manualNear = false;
function takePictures() {
  if (pictured === data || !inView()) return;
  pictured = data;
  const [wide, high] = [560, 360];
  const taken = (name, share, without) => view.picture(name, share, wide, high, without);
  const pictures = {
    print: taken("below", 0, [...BELOW, "steel", "ballast", "guard"]),
    washers: taken("below", 1, [...BELOW, "guard"]),
    coils: taken("aslant", 0.35, ["pad", "steel", "ballast", "guard"]),
    wires: taken("top", 0, ["pad", "steel", "ballast", "guard"]),
    pad: taken("aslant", 0.55, []),
  };
  put("manual-body", manual(data, pictures));
}

// One entry --------------------------------------------------------------------------------------------------------

function scene() {
  const first = !view?.shows();
  view?.show(data);
  paint();
  marks();
  if (!first) return;
  view?.resize();
  view?.look("aslant");
  view?.drawNow(); // the first picture does not wait for the tables
}

function assembly() {
  put("manual-body", manual(data, {}));
  if (manualNear) takePictures();
}

const SECTIONS = {
  view: scene,
  // Those of `data.charts` are drawn with the figures.
  ...Object.fromEntries(CHARTS.map((name) => [name, () => name in data.charts || showFigure(data, name)])),
  checks,
  study: () => put("study-body", study(data)),
  bom: billOfMaterials,
  taxels: taxelTable,
  manual: assembly,
  origin,
};

/** Show the figures of `next`: verdict, levels, ladder, driver table; the chosen taxel (by its id) and the state stay. */
function figures(next) {
  next.index = new Map(next.taxels.id.map((id, index) => [id, index]));
  data = next;
  first();
  setState(state.bits);
  select(data.index.has(state.selected) ? state.selected : null);
  fitCharts();
  for (const name of Object.keys(data.charts)) showFigure(data, name);
  driverTable();
}

/** Render everything anew from `next`; camera, colours, the chosen taxel and the state stay. */
function show(next) {
  figures(next);
  for (const draw of Object.values(SECTIONS)) draw();
  document.dispatchEvent(new Event("padgen-show"));
}

// Where nothing is painted, as in a tab behind others, no frame comes.
const painted = () => new Promise((done) => (requestAnimationFrame(() => setTimeout(done)), setTimeout(done, 250)));

/**
 * Render what `figures` has left, with the parts of the `rest`: the sections in sight, and, once these are painted, all
 * others, unless `isLate()`.
 */
async function follow(rest, isLate) {
  Object.assign(data, rest);
  const inSight = (id) => {
    const { top, bottom } = byId(id).getBoundingClientRect();
    return bottom > 0 && top < innerHeight;
  };
  const ids = Object.keys(SECTIONS);
  const near = ids.filter(inSight);
  for (const id of near) SECTIONS[id]();
  await painted();
  if (isLate()) return;
  for (const id of ids) if (!near.includes(id)) SECTIONS[id]();
  document.dispatchEvent(new Event("padgen-show"));
}

window.padgen = {
  show,
  figures,
  follow,
  painted,
  select,
  play,
  moveTo,
  setState,
  get data() {
    return data;
  },
  get state() {
    return { ...state };
  },
  /** Felt level of each taxel in µm in the state shown, by id. */
  get levels() {
    return Object.fromEntries(data.taxels.id.map((id, index) => [id, frame.motions[index].level_um]));
  },
  displaced,
  /** Where a taxel's boss is on the page, in CSS pixels. */
  placeOf: (id) => view.placeOf(...placeOf(data.index.get(id)), data.pad.boss_top_mm),
  view: () => view,
};

makeOnce();
show(JSON.parse(byId("data").textContent));
