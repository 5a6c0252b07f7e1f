// Tables that sort by a click on a heading, copy themselves, and show long ones in steps.

import { byId, h } from "./dom.js";

const FIRST = 40;
const PRINTED = 12;

/** Say on paper how many of so many rows are not on it, and where they are. */
export const unprinted = (count, what, where) => (count > 0 ? h("p", { class: "only-print soft" }, `${count} more ${what}${count > 1 ? "s" : ""}: see ${where}`) : null);

/**
 * Make a table. `columns` are {name, unit?, left?}, `rows` arrays of {text, value?} or plain texts and numbers;
 * `click(row index)` makes rows clickable; `file` has all rows of a table that paper has the first of.
 */
export function table(caption, columns, rows, { click = null, copy = false, file = "" } = {}) {
  let order = rows.map((_, index) => index);
  let sorted = null;
  let shown = FIRST;
  const body = h("tbody");
  const cell = (entry) => (entry !== null && typeof entry === "object" ? entry : { text: entry === null ? "–" : String(entry), value: entry });
  const more = h("button", { type: "button", class: "no-print", on: { click: () => ((shown = Infinity), fill()) } }, `Show all ${rows.length}`);

  function fill() {
    body.replaceChildren(
      ...order.slice(0, shown).map((index, place) =>
        h(
          "tr",
          {
            class: [place >= PRINTED ? "beyond" : "", click ? "choose" : ""].join(" ").trim() || null,
            on: click ? { click: () => click(index) } : {},
          },
          rows[index].map((entry, k) => {
            const { text } = cell(entry);
            const inner = click && k === 0 ? h("button", { type: "button", class: "link" }, text) : text;
            return k === 0 ? h("th", { scope: "row" }, inner) : h("td", { class: columns[k].left ? "left" : null }, inner);
          }),
        ),
      ),
    );
    more.hidden = shown >= rows.length;
  }

  function sort(k, button) {
    const down = sorted === k;
    sorted = down ? null : k;
    const key = (index) => cell(rows[index][k]).value ?? cell(rows[index][k]).text;
    order.sort((a, b) => {
      const [one, other] = [key(a), key(b)];
      const sign = typeof one === "number" && typeof other === "number" ? one - other : String(one).localeCompare(String(other), "en", { numeric: true });
      return (down ? -sign : sign) || a - b;
    });
    for (const each of button.closest("tr").children) each.removeAttribute("aria-sort");
    button.parentElement.setAttribute("aria-sort", down ? "descending" : "ascending");
    fill();
  }

  const head = h(
    "tr",
    {},
    columns.map((column, k) => {
      const button = h("button", { type: "button", on: { click: () => sort(k, button) } }, column.name, column.unit ? h("span", { class: "unit" }, ` ${column.unit}`) : null);
      return h("th", { scope: "col", class: column.left || k === 0 ? "left" : null }, button);
    }),
  );
  fill();
  return h(
    "div",
    {},
    h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": caption }, h("table", {}, h("caption", { class: "hidden" }, caption), h("thead", {}, head), body)),
    h("p", { class: "no-print row" }, more, copy ? copyButton(columns, rows, cell) : null),
    unprinted(rows.length - PRINTED, "row", file),
  );
}

function copyButton(columns, rows, cell) {
  const button = h("button", { type: "button" }, "Copy as CSV");
  const quoted = (text) => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
  button.addEventListener("click", async () => {
    const lines = [columns.map((column) => column.key ?? column.name), ...rows.map((row) => row.map((entry) => cell(entry).value ?? cell(entry).text))];
    const text = lines.map((line) => line.map((entry) => quoted(String(entry ?? ""))).join(",")).join("\n");
    try {
      await navigator.clipboard.writeText(text);
      button.textContent = "Copied";
    } catch {
      // Pages opened from a file may not write to the clipboard everywhere: offer the text to be copied by hand.
      const area = h("textarea", { readonly: true, rows: 6, "aria-label": "Table as CSV" }, text);
      button.after(area);
      area.select();
    }
    setTimeout(() => (button.textContent = "Copy as CSV"), 2000);
  });
  return button;
}

export const facts = (pairs) => pairs.flatMap(([name, value]) => [h("dt", {}, name), h("dd", {}, value)]);

export function jump(id) {
  byId(id).scrollIntoView({ behavior: matchMedia("(prefers-reduced-motion: reduce)").matches ? "auto" : "smooth", block: "start" });
}
