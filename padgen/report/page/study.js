// What a study of this folder measured, and what the models leave out.

import { fitCharts } from "./charts.js";
import { h, num } from "./dom.js";
import { chart } from "./figures.js";

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
  const { figure, rungs } = data.study;
  if (!rungs.length) return h("div", {}, h("p", {}, "The study in this folder has no rung with a known error."), leftOut(data));
  fitCharts();
  const rows = rungs.map((rung) => h("tr", {}, h("th", { scope: "row" }, rung.ladder), h("td", { class: "left" }, `${rung.model}, ${rung.resolution}`), h("td", {}, `${num(rung.seconds, 2)} s`), h("td", {}, `${num(100 * rung.error, 2)} %`)));
  return h(
    "div",
    {},
    figure.panels.map((panel) => [h("p", { class: "name" }, panel.title), chart(panel, figure, data)]).flat(2),
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
