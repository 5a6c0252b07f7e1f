// Figures as padgen made them (padgen/report/figures): one function for each kind of marks, none for a single figure.

import { fitCharts, logLabel, logTicks, ticks, wide } from "./charts.js";
import { showCurves } from "./curves.js";
import { byId, fixed, h, heat, inkOn, num, put, s } from "./dom.js";

/** Return a role's colour for styles: the page's own where it has one, which follows light, dark and paper. */
const paintOf = (data, role) => (role.startsWith("channel-") ? data.colours[Number(role.slice(8))] : `var(--role-${role}, ${data.roles[role] || "currentColor"})`);

/** Return the function from values to px between those of the ends of an axis; what lies outside is put on an end. */
function places(scale, from, to) {
  const at = scale.is_log ? Math.log : (value) => value;
  const [low, high] = [at(scale.low), at(scale.high)];
  return (value) => from + ((to - from) * (at(Math.min(Math.max(value, scale.low), scale.high)) - low)) / (high - low);
}

const inside = (scale, value) => value >= scale.low && value <= scale.high;
const title = (scale) => (scale.unit ? `${scale.label}, ${scale.unit}` : scale.label);
const named = (scale, name) => (scale.short ? `${scale.short} ${name}` : name);
const labelled = (scale, value) => (scale.is_log ? logLabel(scale, value) : num(value));
const kindOf = (panel) => (panel.marks.length ? panel.marks[0].kind : "points");

/** Return lines across a chart from top to bottom, or from left to right, with their labels above. */
function across(panel, data, x, y) {
  return panel.lines
    .filter((line) => inside(line.axis === "x" ? panel.x : panel.y, line.at) || line.label)
    .map((line) => {
      const [x0, x1, y0, y1] = line.axis === "x" ? [x(line.at), x(line.at), y(panel.y.high), y(panel.y.low)] : [x(panel.x.low), x(panel.x.high), y(line.at), y(line.at)];
      const label = line.axis === "x" ? { x: Math.min(Math.max(x0, x(panel.x.low) + 50), x(panel.x.high) - 48), y: y0 - 9, "text-anchor": "middle" } : { x: x1, y: y1 - 5, "text-anchor": "end" };
      return s("g", {}, s("line", { x1: x0, x2: x1, y1: y0, y2: y1, class: "across", "stroke-dasharray": line.is_dashed ? "6 4" : "2 3", paint: { stroke: paintOf(data, line.role) } }), s("text", { ...label, class: "name" }, line.label));
    });
}

/** Marks in rows with their spans and whiskers; names at the left, values at the right. */
function rows(panel, figure, data) {
  const count = Math.round(panel.y.high - panel.y.low);
  const row = count > 24 ? 12 : 26;
  const [left, right, top] = [58, 74, 8];
  const high = top + count * row;
  const x = places(panel.x, left, wide() - right);
  const y = (place) => top + place * row;
  const grid = (panel.x.is_log ? logTicks : ticks)(panel.x.low, panel.x.high).flatMap((value) => [
    s("line", { x1: x(value), x2: x(value), y1: top, y2: high, class: "grid" }),
    s("text", { x: x(value), y: high + 16, "text-anchor": "middle" }, num(value)),
  ]);
  const marks = panel.marks.flatMap((series) =>
    series.rows.map((place, k) => {
      const colour = paintOf(data, series.roles[k] || series.role);
      const [from, to] = series.spans[k].map(x);
      const [near, far] = [-1, 1].map((side) => x(series.marks[k] + side * series.sigmas[k]));
      const middle = y(place) + row / 2;
      return s(
        "g",
        {},
        s("rect", { x: from, y: y(place) + 3, width: Math.max(to - from, 1), height: row - 6, "fill-opacity": 0.28, rx: 3, paint: { fill: colour } }),
        s("path", { d: `M${near} ${middle - 4}v8M${near} ${middle}H${far}M${far} ${middle - 4}v8`, class: "whisker" }),
        s("line", { x1: x(series.marks[k]), x2: x(series.marks[k]), y1: y(place) + 1, y2: y(place) + row - 1, "stroke-width": 3, paint: { stroke: colour } }),
      );
    }),
  );
  const shown = panel.row_labels.filter((_, k) => row > 20 || k % 2 === 0);
  const names = shown.flatMap((label) => [
    s("text", { x: left - 8, y: y(label.at) + row / 2 + 4, "text-anchor": "end" }, named(panel.y, label.name)),
    s("text", { x: wide() - right + 8, y: y(label.at) + row / 2 + 4 }, label.value),
  ]);
  const lines = panel.lines.filter((line) => line.axis === "x" && inside(panel.x, line.at)).map((line) => s("line", { x1: x(line.at), x2: x(line.at), y1: top, y2: high, class: "across", "stroke-dasharray": "2 3", paint: { stroke: paintOf(data, line.role) } }, s("title", {}, line.label)));
  const [first] = panel.marks;
  return [
    s("svg", { viewBox: `0 0 ${wide()} ${high + 38}`, role: "img", "aria-label": figure.description }, grid, marks, lines, names, s("text", { x: (left + wide() - right) / 2, y: high + 33, "text-anchor": "middle", class: "name" }, title(panel.x))),
    h("p", { class: "key" }, h("span", { class: "swatch slot" }), first.span_label, h("span", { class: "swatch line" }), first.mark_label, h("span", { class: "swatch whisker" }), first.sigma_label),
  ];
}

/** Bars, stems and points between two axes. */
export function chart(panel, figure, data) {
  const [left, top, high, foot] = [52, 28, 210, 46];
  const x = places(panel.x, left, wide() - 14);
  const y = places(panel.y, top + high, top);
  const grid = (panel.x.is_log ? logTicks : ticks)(panel.x.low, panel.x.high, wide() > 500 ? 9 : 5).map((value) => s("g", {}, s("line", { x1: x(value), x2: x(value), y1: top, y2: top + high, class: "grid" }), s("text", { x: x(value), y: top + high + 16, "text-anchor": "middle" }, labelled(panel.x, value))));
  const heights = (panel.y.is_log ? logTicks : ticks)(panel.y.low, panel.y.high, 4).map((value) => s("text", { x: left - 6, y: y(value) + 4, "text-anchor": "end" }, labelled(panel.y, value)));
  const drawn = {
    bars: (mark) => mark.counts.map((count, k) => (count ? s("rect", { x: x(mark.edges[k]) + 0.5, y: y(count), width: Math.max(x(mark.edges[k + 1]) - x(mark.edges[k]) - 1, 0.5), height: top + high - y(count) }) : null)),
    stems: (mark) => mark.x.map((at, k) => s("line", { x1: x(at), x2: x(at), y1: top + high, y2: y(mark.y[k]), "stroke-width": 2, paint: { stroke: paintOf(data, mark.role) } })),
  };
  const marks = panel.marks.map((mark) => s("g", { class: `${mark.kind} role-${mark.role}`, paint: { fill: paintOf(data, mark.role) } }, drawn[mark.kind]?.(mark) ?? []));
  const single = panel.points.flatMap((points) =>
    points.x.flatMap((at, k) => {
      const colour = paintOf(data, points.roles[k]);
      const ring = points.rings[k] ? s("circle", { cx: x(at), cy: y(points.y[k]), r: 9, class: "ring" }, s("title", {}, points.rings[k])) : null;
      return [s("circle", { cx: x(at), cy: y(points.y[k]), r: 4.5, "stroke-width": 2, paint: points.hollow[k] ? { fill: "none", stroke: colour } : { fill: colour } }, points.names[k] ? s("title", {}, points.names[k]) : null), ring];
    }),
  );
  const middle = top + high / 2;
  return [
    s("svg", { viewBox: `0 0 ${wide()} ${top + high + foot}`, role: "img", "aria-label": figure.description }, grid, heights, marks, single, across(panel, data, x, y), s("text", { x: (left + wide()) / 2, y: top + high + 36, "text-anchor": "middle", class: "name" }, title(panel.x)), s("text", { x: 12, y: middle, class: "name", "text-anchor": "middle", transform: `rotate(-90 12 ${middle})` }, title(panel.y))),
    h("p", { class: "key" }, [...panel.marks, ...panel.points.map((points) => ({ role: points.legend_role, label: points.label }))].flatMap((mark) => [h("span", { class: "swatch", paint: { background: paintOf(data, mark.role) } }), mark.label])),
  ];
}

/** Discs to scale with their numbers, over the outlines of what they lie in. */
function discs(panel, figure) {
  const [x0, x1, y0, y1] = [panel.x.low, panel.x.high, panel.y.low, panel.y.high];
  const size = Math.max(x1 - x0, y1 - y0) / 62;
  const shapes = panel.shapes.flatMap((shape) => [
    s("polygon", { points: shape.corners.map(([x, y]) => `${x},${-y}`).join(" "), class: shape.role, "stroke-width": 0.3 * size }),
    shape.note ? s("text", { x: shape.corners[0][0] - size, y: -y0 + 3.6 * size, "font-size": 2.3 * size, class: "name" }, `▲ ${shape.note}`) : null,
  ]);
  const marks = panel.marks.flatMap((mark) =>
    mark.x.flatMap((x, k) => {
      const font = Math.min(3.6 * size, mark.diameter * 0.425);
      const y = -mark.y[k];
      const style = { class: mark.role, "stroke-width": 0.35 * size };
      const outline = mark.depth === null
        ? s("circle", { cx: x, cy: y, r: mark.diameter / 2, ...style })
        : s("rect", { x: x - mark.diameter / 2, y: y - mark.depth / 2, width: mark.diameter, height: mark.depth, ...style });
      return [outline, s("text", { x, y: y + font * 0.36, "text-anchor": "middle", "font-size": font, class: "number" }, mark.numbers[k])];
    }),
  );
  return [s("svg", { viewBox: `${x0 - 2 * size} ${-y1 - 2 * size} ${x1 - x0 + 4 * size} ${y1 - y0 + 7 * size}`, class: "map", role: "img", "aria-label": figure.description }, shapes, marks)];
}

/** A table of values, the brighter the larger, framed where less than asked; its diagonal is what is on. */
function matrix(panel) {
  const [table] = panel.marks;
  const head = h("tr", {}, h("td"), table.names.map((name) => h("th", { scope: "col" }, named(panel.x, name))));
  const body = table.values.map((row, i) =>
    h(
      "tr",
      {},
      h("th", { scope: "row" }, named(panel.y, table.names[i])),
      row.map((value, j) => {
        if (i === j) return h("td", { class: "own" }, "on");
        const colour = heat((value - table.z.low) / (table.z.high - table.z.low));
        return h("td", { class: value < table.asked ? "short" : null, paint: { background: colour, color: inkOn(colour) } }, fixed(value, 1));
      }),
    ),
  );
  return h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": table.label }, h("table", { class: "heat" }, h("caption", {}, table.label), h("thead", {}, head), h("tbody", {}, body)));
}

function factsOf(facts) {
  const body = h("tbody", {}, facts.rows.map(([name, ...values]) => h("tr", {}, h("th", { scope: "row" }, name), values.map((value, k) => h("td", { class: k ? "left" : null }, value)))));
  if (!facts.is_folded) return h("table", { class: "plain" }, h("caption", {}, facts.caption), body);
  return h("details", { open: facts.is_open }, h("summary", {}, facts.caption), h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": facts.caption }, h("table", {}, body)));
}

/** Draw the figure of a name into its section, the one that is chosen where there are several. */
export function showFigure(data, name) {
  const figures = { ...data.charts, ...data.later_charts }[name];
  const select = byId(`${name}-which`);
  const which = Math.min(Number(select.value) || 0, figures.length - 1);
  put(select.id, figures.map((each, k) => h("option", { value: k, selected: k === which }, each.label)));
  select.labels[0].textContent = figures[0].choice;
  select.parentElement.hidden = figures.length < 2;
  const figure = figures[which];
  fitCharts();
  const [first] = figure.panels;
  const kind = first && kindOf(first);
  const hosts = [];
  const drawn = { rows, matrix, discs, curves: () => hosts[hosts.push(h("div", { class: "plot" })) - 1] };
  const panels = figure.panels.flatMap((panel) => (drawn[kindOf(panel)] || chart)(panel, figure, data));
  const facts = figure.facts && factsOf(figure.facts);
  const notes = figure.notes.length ? h("p", { class: first && kind !== "curves" ? null : "soft" }, figure.notes.join(" ")) : null;
  const beside = (first && facts && !figure.facts.is_folded) || kind === "discs";
  put(
    `${name}-body`,
    figure.instead ? h("p", {}, figure.instead) : null,
    beside ? h("div", { class: "sides" }, h("div", {}, panels), h("div", {}, facts, notes)) : [kind === "matrix" ? h("div", { class: "heats" }, panels) : h("div", {}, panels), facts, figure.instead ? null : notes].flat(),
  );
  showCurves(name, hosts, figure, data, figure.panels.filter((panel) => kindOf(panel) === "curves"));
}
