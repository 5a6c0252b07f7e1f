// Small charts as SVG and HTML: they print, scale, and screen readers read them.

import { fixed, h, heat, inkOn, num, powerOfTen, s } from "./dom.js";

// Charts are drawn as wide as the page lets them be, so that their text keeps its size on a phone.
let WIDE = 720;
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

/** Return round frequencies for a logarithmic axis. */
export function logTicks(low, high) {
  const found = [];
  for (let power = Math.floor(Math.log10(low)); power <= Math.ceil(Math.log10(high)); power++)
    for (const n of [1, 1.5, 2, 3, 4, 5, 6, 8]) found.push(Number((n * 10 ** power).toPrecision(3)));
  const inside = found.filter((hz) => hz >= low && hz <= high);
  return inside.length > 9 ? inside.filter((hz) => /^[125]/.test(String(hz).replace(/^[0.]+/, "")) && !/^15/.test(String(hz))) : inside;
}

export function ladder(data) {
  const { channels } = data;
  const count = channels.length;
  const row = count > 24 ? 12 : 26;
  const [left, right, top] = [58, 74, 8];
  const high = top + count * row;
  const ends = data.ladder.flat().concat(channels.flatMap((c) => [c.resonance_hz * (1 - c.print_spread), c.resonance_hz * (1 + c.print_spread)]));
  const [low, most] = [Math.max(Math.min(...ends) * 0.97, channels[0].resonance_hz / 4), Math.max(...ends) * 1.03];
  const x = (hz) => left + ((WIDE - left - right) * Math.log(Math.max(hz, low) / low)) / Math.log(most / low);
  const marks = logTicks(low, most).flatMap((hz) => [
    s("line", { x1: x(hz), x2: x(hz), y1: top, y2: high, class: "grid" }),
    s("text", { x: x(hz), y: high + 16, "text-anchor": "middle" }, num(hz)),
  ]);
  channels.forEach((channel, k) => {
    const [y, colour] = [top + k * row, data.colours[k]];
    const [from, to] = data.ladder[k];
    const [near, far] = [1 - channel.print_spread, 1 + channel.print_spread].map((share) => x(channel.resonance_hz * share));
    marks.push(
      s("rect", { x: x(from), y: y + 3, width: Math.max(x(to) - x(from), 1), height: row - 6, fill: colour, "fill-opacity": 0.28, rx: 3 }),
      s("path", { d: `M${near} ${y + row / 2 - 4}v8M${near} ${y + row / 2}H${far}M${far} ${y + row / 2 - 4}v8`, class: "whisker" }),
      s("line", { x1: x(channel.resonance_hz), x2: x(channel.resonance_hz), y1: y + 1, y2: y + row - 1, stroke: colour, "stroke-width": 3 }),
    );
    if (row > 20 || k % 2 === 0)
      marks.push(
        s("text", { x: left - 8, y: y + row / 2 + 4, "text-anchor": "end" }, `ch ${channel.index}`),
        s("text", { x: WIDE - right + 8, y: y + row / 2 + 4 }, `${fixed(channel.resonance_hz, 1)} Hz`),
      );
  });
  return h(
    "div",
    {},
    s("svg", { viewBox: `0 0 ${WIDE} ${high + 38}`, role: "img", "aria-label": `Resonances of ${count} channels from ${fixed(channels[0].resonance_hz, 1)} to ${fixed(channels[count - 1].resonance_hz, 1)} hertz, each within its slot` }, marks, s("text", { x: (left + WIDE - right) / 2, y: high + 33, "text-anchor": "middle", class: "name" }, "frequency, Hz")),
    h("p", { class: "key" }, h("span", { class: "swatch slot" }), "slot with guard bands", h("span", { class: "swatch line" }), "resonance", h("span", { class: "swatch whisker" }), "one sigma of prints"),
  );
}

export function heatMap(data) {
  const { selectivity } = data;
  if (!selectivity.matrix_db.length) {
    const alone = data.motion.sets[0].channels.length < 2;
    return h("p", {}, alone ? "A coil has one channel, so no taxel hears another of its coil." : "With so many channels the plan keeps no table; the response above and the driver table have the figures.");
  }
  const asked = selectivity.asked_db;
  const part = selectivity.matrix_db.map((rows, which) => {
    const names = selectivity.sets[which];
    const head = h("tr", {}, h("td"), names.map((name) => h("th", { scope: "col" }, `tone ${name}`)));
    const body = rows.map((row, i) =>
      h(
        "tr",
        {},
        h("th", { scope: "row" }, `taxel ${names[i]}`),
        row.map((db, j) => {
          if (i === j) return h("td", { class: "own" }, "on");
          const share = Math.min(Math.max(db / (2 * asked), 0), 1); // brighter: more selective
          const colour = heat(share);
          return h("td", { paint: { background: colour, color: inkOn(colour) } }, fixed(db, 1));
        }),
      ),
    );
    const title = data.motion.sets.length > 1 ? `Coils of set ${which}, dB` : "dB below its own level";
    return h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": title }, h("table", { class: "heat" }, h("caption", {}, title), h("thead", {}, head), h("tbody", {}, body)));
  });
  const words = [`Asked are ${fixed(asked, 1)} dB.`];
  if (selectivity.one_hot_db !== null) words.push(`With one channel on a coil keeps ${fixed(selectivity.one_hot_db, 1)} dB, in its worst state (${selectivity.worst_state.slice(0, 24)}) ${fixed(Math.min(selectivity.all_states_db, selectivity.placed_all_states_db), 1)} dB, as drawn.`);
  return h("div", {}, h("div", { class: "heats" }, part), h("p", {}, words.join(" ")));
}

export function histogram(data) {
  const { prints } = data;
  const kept = prints.stages.map((stage, k) => [stage, prints.kept_db[k]]).filter(([, db]) => db !== null);
  if (!kept.length) return h("p", {}, "Nothing moves OFF taxels of this pad, so there is no limit to what prints keep.");
  const told = h(
    "table",
    { class: "plain" },
    h("caption", {}, `ON over OFF that ${num(100 * prints.share, 3)} % of prints keep`),
    h("tbody", {}, kept.map(([stage, db]) => h("tr", {}, h("th", { scope: "row" }, stage), h("td", {}, `${fixed(db, 1)} dB`)))),
  );
  if (!prints.counts.length) return h("div", {}, told, h("p", { class: "soft" }, "The histogram is counted when the report is written."));
  const [left, top, high, foot] = [52, 28, 210, 46];
  const edges = prints.edges_db;
  const most = Math.max(...prints.counts.flat(), 1);
  const x = (db) => left + ((WIDE - left - 14) * (db - edges[0])) / (edges[edges.length - 1] - edges[0]);
  const y = (count) => top + high * (1 - count / most);
  const marks = ticks(edges[0], edges[edges.length - 1], WIDE > 500 ? 9 : 5).map((db) => s("g", {}, s("line", { x1: x(db), x2: x(db), y1: top, y2: top + high, class: "grid" }), s("text", { x: x(db), y: top + high + 16, "text-anchor": "middle" }, num(db))));
  const yMarks = ticks(0, most, 4).map((count) => s("text", { x: left - 6, y: y(count) + 4, "text-anchor": "end" }, num(count)));
  const bars = prints.counts.map((counts, k) =>
    s("g", { class: `bars bars-${k}` }, counts.map((count, bin) => (count ? s("rect", { x: x(edges[bin]) + 0.5, y: y(count), width: Math.max(x(edges[bin + 1]) - x(edges[bin]) - 1, 0.5), height: top + high - y(count) }) : null))),
  );
  const at = x(Math.min(Math.max(prints.asked_db, edges[0]), edges[edges.length - 1]));
  const asked = s("g", {}, s("line", { x1: at, x2: at, y1: top, y2: top + high, class: "asked" }), s("text", { x: Math.min(Math.max(at, left + 50), WIDE - 62), y: top - 9, "text-anchor": "middle", class: "name" }, `asked ${fixed(prints.asked_db, 1)} dB`));
  return h(
    "div",
    { class: "sides" },
    h("div", {}, s("svg", { viewBox: `0 0 ${WIDE} ${top + high + foot}`, role: "img", "aria-label": `Histogram of ${prints.pads} simulated prints; the table below has its figures` }, marks, yMarks, bars, asked, s("text", { x: (left + WIDE) / 2, y: top + high + 36, "text-anchor": "middle", class: "name" }, "ON over OFF of a print's worst coil, dB"), s("text", { x: 12, y: top + high / 2, class: "name", "text-anchor": "middle", transform: `rotate(-90 12 ${top + high / 2})` }, "prints")),
    h("p", { class: "key" }, prints.counted.flatMap((stage, k) => [h("span", { class: `swatch bars-${k}` }), stage]))),
    h("div", {}, told, h("p", {}, `${num(100 * prints.good_share, 3)} % of ${prints.pads} prints reach the ${fixed(prints.asked_db, 1)} dB asked for, once every taxel is measured and re-tuned.`)),
  );
}

export function wiring(data) {
  const { coils, pad } = data;
  const [halfX, halfY] = [pad.width_mm / 2 + pad.border_mm, pad.depth_mm / 2 + pad.border_mm];
  const size = Math.max(halfX, halfY) / 31;
  const [gx0, gx1, gy0, gy1] = pad.groove_mm;
  const r = pad.coil_mm[0] / 2;
  const font = Math.min(3.6 * size, r * 0.85);
  const marks = [
    s("rect", { x: -halfX, y: -halfY, width: 2 * halfX, height: 2 * halfY, rx: pad.border_mm / 2, class: "plate", "stroke-width": 0.3 * size }),
    s("rect", { x: gx0, y: -gy1, width: gx1 - gx0, height: gy1 - gy0, class: "groove" }),
    ...coils.places.flatMap(([x, y], k) => [
      s("circle", { cx: x, cy: -y, r, class: "coil", "stroke-width": 0.35 * size }),
      s("text", { x, y: -y + font * 0.36, "text-anchor": "middle", "font-size": font, class: "number" }, String(k + 1)),
    ]),
    s("text", { x: gx0 - size, y: halfY + 3.6 * size, "font-size": 2.3 * size, class: "name" }, "▲ groove: the corner of coil 1"),
  ];
  const note = data.motion.sets.length > 1 ? ` Coils of two kinds alternate: ${data.motion.sets.map((set, k) => `set ${k} plays channels ${set.channels.join(", ")}`).join("; ")}.` : "";
  return h(
    "div",
    { class: "sides" },
    s("svg", { viewBox: `${-halfX - 2 * size} ${-halfY - 2 * size} ${2 * halfX + 4 * size} ${2 * halfY + 7 * size}`, class: "map", role: "img", "aria-label": `${coils.places.length} coils in ${coils.rows} rows and ${coils.columns} columns, numbered row by row from the corner with the groove` }, marks),
    h("p", {}, `Output k of the amplifiers feeds coil k; the WAV file has its channels in the same order, row by row from the corner with the groove. Connect all coils alike.${note}`),
  );
}

export function study(data) {
  if (!data.study) {
    const worst = data.channels.reduce((a, b) => (b.model_error > a.model_error ? b : a));
    const models = [...new Set(data.channels.map((channel) => channel.model))].join(" and ");
    return h(
      "div",
      {},
      h("p", {}, `By the ${models} model, whose own estimate of its error in a resonance is at most ${num(100 * worst.model_error, 2)} % here. `, h("code", {}, `padgen study ${data.name.slice(0, 80)}`), " measures every model behind these figures, error against run time; the next report then shows it here."),
      leftOut(data),
    );
  }
  const rungs = data.study.ladders.flatMap((ladder) => ladder.rungs.map((rung) => ({ ...rung, ladder: ladder.ladder }))).filter((rung) => rung.seconds > 0 && rung.error_at_most > 0);
  if (!rungs.length) return h("div", {}, h("p", {}, "The study in this folder has no rung with a known error."), leftOut(data));
  const names = [...new Set(rungs.map((rung) => rung.ladder))];
  const colourOf = (name) => data.palette[names.indexOf(name) % data.palette.length];
  const [left, top, high] = [66, 10, 260];
  const span = (values) => [Math.floor(Math.log10(Math.min(...values))), Math.ceil(Math.log10(Math.max(...values)) + 1e-9)];
  const [x0, x1] = span(rungs.map((rung) => rung.seconds));
  const [y0, y1] = span(rungs.map((rung) => Math.max(rung.error_at_most, 1e-12)));
  const x = (v) => left + ((WIDE - left - 16) * (Math.log10(v) - x0)) / Math.max(x1 - x0, 1);
  const y = (v) => top + high * (1 - (Math.log10(Math.max(v, 1e-12)) - y0) / Math.max(y1 - y0, 1));
  const marks = [];
  for (let k = x0; k <= x1; k++) marks.push(s("line", { x1: x(10 ** k), x2: x(10 ** k), y1: top, y2: top + high, class: "grid" }), s("text", { x: x(10 ** k), y: top + high + 16, "text-anchor": "middle" }, powerOfTen(k)));
  for (let k = y0; k <= y1; k++) if ((k - y0) % Math.ceil((y1 - y0) / 8) === 0) marks.push(s("line", { x1: left, x2: WIDE - 16, y1: y(10 ** k), y2: y(10 ** k), class: "grid" }), s("text", { x: left - 6, y: y(10 ** k) + 4, "text-anchor": "end" }, powerOfTen(k)));
  for (const rung of rungs)
    marks.push(s("circle", { cx: x(rung.seconds), cy: y(rung.error_at_most), r: 4.5, stroke: colourOf(rung.ladder), "stroke-width": 2, fill: rung.is_bound ? "none" : colourOf(rung.ladder) }, s("title", {}, `${rung.ladder}: ${rung.model}, ${rung.resolution}`)));
  const rows = rungs.map((rung) => h("tr", {}, h("th", { scope: "row" }, rung.ladder), h("td", { class: "left" }, `${rung.model}, ${rung.resolution}`), h("td", {}, `${num(rung.seconds, 2)} s`), h("td", {}, `${num(100 * rung.error_at_most, 2)} %`)));
  return h(
    "div",
    {},
    s("svg", { viewBox: `0 0 ${WIDE} ${top + high + 40}`, role: "img", "aria-label": "Error against run time; the table below has the figures" }, marks, s("text", { x: (left + WIDE) / 2, y: top + high + 34, "text-anchor": "middle", class: "name" }, "run time, s"), s("text", { x: 12, y: top + high / 2, "text-anchor": "middle", class: "name", transform: `rotate(-90 12 ${top + high / 2})` }, "relative error")),
    h("p", { class: "key" }, names.flatMap((name, k) => [h("span", { class: "swatch", paint: { background: colourOf(names[k]) } }), name]), h("span", {}, "(hollow: at most)")),
    h("details", {}, h("summary", {}, "All rungs as a table"), h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "All rungs" }, h("table", {}, h("thead", {}, h("tr", {}, ["ladder", "model", "run time", "error at most"].map((name, k) => h("th", { scope: "col", class: k < 2 ? "left" : null }, name)))), h("tbody", {}, rows)))),
    leftOut(data),
  );
}

function leftOut(data) {
  const rows = data.left_out.map((entry) => {
    const bound = entry.bound === null ? "–" : entry.unit === "1" ? `${num(100 * entry.bound, 2)} %` : `${num(entry.bound, 2)} ${entry.unit}`;
    return h("tr", {}, h("th", { scope: "row" }, entry.term), h("td", { class: "left" }, entry.of), h("td", {}, bound), h("td", { class: "left" }, entry.computed ? "counted" : entry.status === "unbounded" ? "left out, no bound known" : "left out"));
  });
  return h("details", {}, h("summary", {}, `What the models leave out (${data.left_out.filter((entry) => !entry.computed).length} effects), with bounds`), h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "What is left out" }, h("table", {}, h("thead", {}, h("tr", {}, ["effect", "changes", "by at most", "treated"].map((name, k) => h("th", { scope: "col", class: k === 2 ? null : "left" }, name)))), h("tbody", {}, rows))));
}
