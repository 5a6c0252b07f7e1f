// Responses of the channels of one coil over frequency, with the tones that are played and the spurs that they make.

import uPlot from "uplot";
import { byId, fixed, h, num, put } from "./dom.js";
import { felt, linesOf, response } from "./motion.js";
import { logTicks } from "./charts.js";

const POINTS = 700;
const LOW_DB = -70;
const MOST_SPURS = 40;

let plot = null;
let watcher = null;

export function showResponses(data, which) {
  const set = data.motion.sets[which];
  const own = set.channels.map((index) => data.channels[index]);
  const lines = linesOf(data, which, set.channels.map((_, i) => i));
  const spurs = lines.filter((line) => line.kind !== "tone").slice(0, MOST_SPURS);
  const hz = own.map((channel) => channel.resonance_hz);
  const spurHz = spurs.map((line) => line.hz).filter((f) => f > hz[0] / 4);
  const low = Math.min(hz[0] * 0.7, ...spurHz.map((f) => f * 0.9));
  const high = Math.max(hz[hz.length - 1] * 1.4, ...spurHz.map((f) => f * 1.05));
  // Each resonance has a point of its own, so that its peak is met.
  const x = Array.from({ length: POINTS }, (_, k) => low * (high / low) ** (k / (POINTS - 1))).concat(hz).sort((a, b) => a - b);
  const db = (value) => Math.max(20 * Math.log10(value), LOW_DB);
  const curves = own.map((_, i) => x.map((f) => db(felt(response(data, which, i, f)))));
  const style = getComputedStyle(document.body);
  const [ink, line] = [style.getPropertyValue("--soft").trim(), style.getPropertyValue("--line").trim()];
  const host = byId("response-plot");
  plot?.destroy();
  host.replaceChildren();
  const axis = { stroke: ink, grid: { stroke: line, width: 1 }, ticks: { stroke: line }, font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif" };
  const options = {
    width: host.clientWidth || 640,
    height: 300,
    scales: { x: { time: false, distr: 3, range: [low, high] }, y: { range: [LOW_DB, 4] } },
    axes: [
      { ...axis, label: "frequency of the pull, Hz", labelSize: 22, splits: () => logTicks(low, high), values: (_, values) => values.map((value) => num(value)), filter: (_, values) => values },
      { ...axis, label: "dB of its own full level", labelSize: 22, size: 52 },
    ],
    series: [{ label: "Hz", value: (_, v) => (v === null ? "–" : fixed(v, 1)) }, ...own.map((channel) => ({ label: `ch ${channel.index}`, stroke: data.colours[channel.index], width: 2, points: { show: false }, value: (_, v) => (v === null ? "–" : `${fixed(v, 1)} dB`) }))],
    legend: { show: own.length <= 12, live: true },
    cursor: { drag: { x: false, y: false } },
    hooks: {
      drawClear: [
        (u) => {
          const { ctx } = u;
          ctx.save();
          for (const each of [...spurs, ...lines.filter((l) => l.kind === "tone")]) {
            if (each.hz < low || each.hz > high) continue;
            const at = u.valToPos(each.hz, "x", true);
            ctx.beginPath();
            ctx.setLineDash(each.kind === "tone" ? [] : [5 * devicePixelRatio, 4 * devicePixelRatio]);
            ctx.lineWidth = (each.kind === "tone" ? 1.6 : 1.2) * devicePixelRatio;
            ctx.strokeStyle = each.kind === "tone" ? data.colours[own[each.of[0]].index] : ink;
            ctx.globalAlpha = 0.75;
            ctx.moveTo(at, u.bbox.top);
            ctx.lineTo(at, u.bbox.top + u.bbox.height);
            ctx.stroke();
          }
          ctx.restore();
        },
      ],
    },
  };
  plot = new uPlot(options, [x, ...curves], host);
  plot.root.setAttribute("role", "img");
  plot.root.setAttribute("aria-label", `Responses of ${own.length} channels from ${num(low, 3)} to ${num(high, 3)} hertz; the table below tells the spurs`);
  watcher?.disconnect();
  watcher = new ResizeObserver(() => {
    const width = host.clientWidth;
    if (width && plot && Math.abs(width - plot.width) > 1) plot.setSize({ width, height: 300 });
  });
  watcher.observe(host);
  told(data, which, own, spurs);
}

function told(data, which, own, spurs) {
  if (!spurs.length) {
    const words = { root: "This drive makes no spurs: the current is the root of the wanted pull.", tones: "One channel plays at a time, so that there are no spurs.", biased: "" };
    put("response-told", h("p", { class: "soft" }, own.length < 2 ? "A coil of one channel has no neighbours to hear its tone." : words[data.motion.current] || ""));
    return;
  }
  const rows = spurs.map((line) => {
    const heard = own
      .map((channel, i) => ({ channel, i, db: 20 * Math.log10((felt(response(data, which, i, line.hz)) * line.size) / data.motion.sets[which].line[i]) }))
      .filter(({ i }) => !line.of.includes(i))
      .sort((a, b) => b.db - a.db)[0];
    const made = line.of.map((i) => own[i].index).join(" and ");
    return h("tr", {}, h("th", { scope: "row" }, `${line.kind} of ${made}`), h("td", {}, `${fixed(line.hz, 2)} Hz`), h("td", { class: "left" }, heard ? `moves channel ${heard.channel.index} at ${fixed(heard.db, 1)} dB` : "no third channel hears it"));
  });
  put("response-told", h("details", { open: rows.length <= 4 }, h("summary", {}, `Spurs with all channels on (${rows.length}${rows.length === MOST_SPURS ? " or more" : ""})`), h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Spurs" }, h("table", {}, h("tbody", {}, rows)))));
}
