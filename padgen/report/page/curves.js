// Curves over a common x, with what is under the cursor in the legend, and lines across them.

import uPlot from "uplot";
import { logTicks } from "./charts.js";
import { fixed, num, numbers } from "./dom.js";

const HIGH_PX = 300;
const MOST_NAMED = 12;
const plots = new Map();

/** Draw panels of curves into their hosts, in the place of those that this figure had before. */
export function showCurves(name, hosts, figure, data, panels) {
  for (const { plot, watcher } of plots.get(name) || []) {
    watcher.disconnect();
    plot.destroy();
  }
  plots.set(name, panels.map((panel, k) => made(hosts[k], panel, figure, data)));
}

function made(host, panel, figure, data) {
  const style = getComputedStyle(document.body);
  const own = (property) => style.getPropertyValue(property).trim();
  const colourOf = (role) => (role.startsWith("channel-") ? data.colours[Number(role.slice(8))] : own(`--role-${role}`) || data.roles[role]);
  const [curves] = panel.marks;
  const [ink, line] = [own("--soft"), own("--line")];
  const { x, y } = panel;
  const at = Array.from(numbers(curves.x));
  const all = numbers(curves.y);
  const each = curves.roles.map((_, k) => Array.from(all.subarray(k * at.length, (k + 1) * at.length), (value) => Math.max(value, y.low)));
  const axis = { stroke: ink, grid: { stroke: line, width: 1 }, ticks: { stroke: line }, font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif" };
  const titled = (scale) => (scale.unit ? `${scale.label}, ${scale.unit}` : scale.label);
  const unit = y.unit.split(" ")[0];
  const plain = x.is_log ? { splits: () => logTicks(x.low, x.high), values: (_, values) => values.map((value) => num(value)), filter: (_, values) => values } : {};
  const options = {
    width: host.clientWidth || 640,
    height: HIGH_PX,
    scales: { x: { time: false, distr: x.is_log ? 3 : 1, range: [x.low, x.high] }, y: { distr: y.is_log ? 3 : 1, range: [y.low, y.high] } },
    axes: [
      { ...axis, label: titled(x), labelSize: 22, ...plain },
      { ...axis, label: titled(y), labelSize: 22, size: 52 },
    ],
    series: [{ label: x.unit || x.label, value: (_, v) => (v === null ? "–" : fixed(v, 1)) }, ...curves.roles.map((role, k) => ({ label: curves.short_labels[k], stroke: colourOf(role), width: 2, points: { show: false }, value: (_, v) => (v === null ? "–" : `${fixed(v, 1)} ${unit}`) }))],
    legend: { show: curves.roles.length <= MOST_NAMED, live: true },
    cursor: { drag: { x: false, y: false } },
    hooks: { drawClear: [(u) => across(u, panel, colourOf)], draw: [(u) => points(u, panel, colourOf)] },
  };
  const plot = new uPlot(options, [at, ...each], host);
  plot.root.setAttribute("role", "img");
  plot.root.setAttribute("aria-label", figure.description);
  const watcher = new ResizeObserver(() => {
    const width = host.clientWidth;
    if (width && Math.abs(width - plot.width) > 1) plot.setSize({ width, height: HIGH_PX });
  });
  watcher.observe(host);
  return { plot, watcher };
}

/** Draw the lines across a panel, below its curves. */
function across(u, panel, colourOf) {
  const { ctx, bbox } = u;
  ctx.save();
  for (const line of panel.lines) {
    const scale = line.axis === "x" ? panel.x : panel.y;
    if (line.at < scale.low || line.at > scale.high) continue;
    const at = u.valToPos(line.at, line.axis, true);
    ctx.beginPath();
    ctx.setLineDash(line.is_dashed ? [5 * devicePixelRatio, 4 * devicePixelRatio] : []);
    ctx.lineWidth = (line.is_dashed ? 1.2 : 1.6) * devicePixelRatio;
    ctx.strokeStyle = colourOf(line.role);
    ctx.globalAlpha = 0.75;
    if (line.axis === "x") {
      ctx.moveTo(at, bbox.top);
      ctx.lineTo(at, bbox.top + bbox.height);
    } else {
      ctx.moveTo(bbox.left, at);
      ctx.lineTo(bbox.left + bbox.width, at);
    }
    ctx.stroke();
  }
  ctx.restore();
}

/** Draw single points over the curves. */
function points(u, panel, colourOf) {
  const { ctx } = u;
  ctx.save();
  for (const each of panel.points)
    each.x.forEach((at, k) => {
      ctx.beginPath();
      ctx.fillStyle = colourOf(each.roles[k]);
      ctx.arc(u.valToPos(at, "x", true), u.valToPos(each.y[k], "y", true), 4 * devicePixelRatio, 0, 2 * Math.PI);
      ctx.fill();
    });
  ctx.restore();
}
