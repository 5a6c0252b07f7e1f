// The assembly manual of this very pad: parts, steps with pictures, wiring, slicer settings, and the check of the wiring.

import { fixed, h, num } from "./dom.js";

export function manual(data, pictures) {
  const { manual: own, pad, coils, taxels, drive } = data;
  const count = coils.places.length;
  const washers = taxels.id.length;
  const mover = own.mover;
  const [tray, screw] = [own.tray, own.screw];
  const inRow = (values) => h("tr", {}, h("th", { scope: "row" }, values[0]), values.slice(1).map((value) => h("td", { class: "left" }, value)));
  const parts = [
    ["Pad", "1", `${num(pad.width_mm + 2 * pad.border_mm)} × ${num(pad.depth_mm + 2 * pad.border_mm)} × ${num(pad.boss_top_mm)} mm, printed ${own.felt} up`],
    [`${mover[0].toUpperCase()}${mover.slice(1)}s`, String(washers), `${own.washer}: ${pad.washer_mm.filter((v) => v).map((v) => num(v)).join(" × ")} mm`],
    ["Glue", `${washers} drops`, own.glue_mg ? `${num(own.glue_mg)} mg each` : "thin, as little as holds; weigh ten"],
    own.board ? ["Board", "1", own.board.part] : ["Coils", String(count), `${own.coil}: ${num(pad.coil_mm[0])} mm across, ${num(pad.coil_mm[1])} mm long`],
    tray ? ["Tray", "1", `${num(tray.height_mm)} mm high; padgen build --parts tray makes its file`] : ["Tray", "none", own.no_tray],
    ["Wires", String(2 * count), tray ? `two from each coil; ${tray.wires} through each slot` : `two from each coil${own.board ? "'s pins on the board" : ""}`],
  ];
  if (own.guard) parts.push(["Guard plate", "1", `${num(own.guard.height_mm)} mm high, holes of ${num(own.guard.hole_diameter_mm)} mm; padgen build --parts guard makes its file`]);
  if (pad.hole_mm) parts.push(["Screws", "4", screw ? `${screw.name} × ${num(screw.length_mm)} mm${screw.nut ? " with nuts" : ""}` : `for ${num(pad.hole_mm)} mm holes`]);
  const first = drive.rows.find((row) => Number.isInteger(row[0]));
  const [hz, mA] = ["drive_hz", "current_ma_peak"].map((name) => first[drive.columns.indexOf(name)]);
  if (own.ballast) parts.splice(2, 0, ["Ballast", String(washers), own.ballast]);
  const steps = [
    ["Print", "print", `Print the pad as it lies in its file, recesses down, without supports, with the settings below.${tray ? " Print the tray with its sockets up, in the same layers, with any infill." : ""}${own.guard ? " Print the guard plate as it lies in its file, its pockets up." : ""} Free the gaps around the plates with a blade: every one of the ${washers} plates must swing.`],
    ...(own.ballast_step ? [["Press in the ballast", "washers", own.ballast_step]] : []),
    [`Glue the ${mover}s`, "washers", `Turn the pad over. A drop of thin glue in each of the ${washers} recesses, then press the ${mover} against ${own.ballast ? "the ballast" : "the roof"}, so that its underside lies ${num(pad.washer_underside_mm, 2)} mm within the plate. No glue may reach a beam.${own.gluing}`],
    own.board ? ["Lay the board", "coils", own.board.step] : ["Set the coils", "coils", tray ? `Lead the wires up in the slot beside each socket, press each of the ${count} coils onto its floor, ${num(tray.floor_mm)} mm above the tray's bed, and hold it with a drop of glue. Coil 1 is in the corner with the groove; numbers go row by row.` : `Hold ${count} coils with their axes at the places of the wiring map, tops in one plane.`],
    ["Lay the wires", "wires", `${tray ? `Between the coils, below their tops, and out by the nearest slots, ${tray.wires} at a slot. ` : ""}Label each pair with its coil's number. ${own.wiring}`],
    ["Screw down the pad", "pad", `${pad.hole_mm ? `Pad on the ${tray ? "rim" : "frame"}, groove above groove, four screws hand-tight.` : "Pad on the rim, groove above groove, glued or clamped along the border."}${own.guard ? " The guard plate lies on the pad under the same screws, pockets down, grooves in line; before they are tight, slide it until every pin stands in the middle of its hole." : ""} The ${mover}s then hang ${num(tray ? tray.gap_mm : pad.gap_mm)} mm above the coils; 0.1 mm changes the pull by some ${num(own.pull_change, 1)} %, so shim short coils with paper.${own.screws}`],
  ];
  return h(
    "div",
    { class: "manual" },
    h("h3", {}, "Parts"),
    h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Parts" }, h("table", {}, h("thead", {}, h("tr", {}, ["part", "how many", "what"].map((name) => h("th", { scope: "col", class: "left" }, name)))), h("tbody", {}, parts.map(inRow)))),
    h("h3", {}, "Steps"),
    h("ol", { class: "steps" }, steps.map(([title, key, text]) => h("li", {}, pictures[key] ? h("img", { src: pictures[key], alt: `${title}: the parts of this step, taken apart`, width: 560, height: 360 }) : null, h("div", {}, h("h4", {}, title), h("p", {}, text))))),
    h("h3", {}, "Set the gain"),
    h("p", {}, own.gain),
    h("h3", {}, "Check the wiring"),
    h("p", {}, `Feed one coil after the other at the lowest channel, ${fixed(hz, 2)} Hz and ${num(mA, 3)} mA peak, and look: the plate of channel ${first[0]} over that coil moves, and no other. `, h("code", {}, `padgen drive ${data.name.slice(0, 80)} --pattern each --seconds 1`), ` plays every taxel in turn${own.has_two_sets ? ", and --pattern crossed the resonances that each coil does not have, which only a swapped one answers" : ""}. Where another plate moves, wires are swapped; where all plates answer as if the pad were turned by 180°, it is.`),
    h("h3", {}, "Slicer settings"),
    h("dl", { class: "facts" }, Object.entries(own.printing).flatMap(([key, value]) => [h("dt", {}, key.replaceAll("_", " ")), h("dd", {}, value)])),
    h("details", {}, h("summary", {}, "By the names that other slicers give them"), h("pre", { tabindex: "0" }, own.slicers)),
  );
}
