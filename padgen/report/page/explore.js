// The form of padgen explore: one control for each field of the spec; every move plans anew and shows the page's new data.
"use strict";
(() => {
  const { schema, values, changed, error: unplanned } = window.padgenForm; // changed: fields by their dotted names
  const token = new URLSearchParams(location.search).get("token");
  const page = `${performance.timeOrigin}-${Math.random()}`; // by which the server knows this page's requests
  const controls = {}; // the same names: {told, input}
  const make = (kind, text, properties) => Object.assign(document.createElement(kind), { textContent: text }, properties);

  async function ask(what, body, signal) {
    const answer = await fetch(`/${what}`, {
      method: "POST",
      headers: { "Content-Type": "application/json", "X-Padgen-Token": token, "X-Padgen-Page": page },
      body: JSON.stringify(body),
      signal,
    });
    const text = await answer.text();
    let data;
    try {
      data = JSON.parse(text);
    } catch {
      data = { error: { where: "", message: text } };
    }
    return data;
  }

  // At most one plan is asked for at a time; moves that come meanwhile are planned together, the newest last. The figures
  // are shown first. All else follows where no newer move waits, and while moves keep coming now and then. A slow plan is
  // given up for a newer move, which also ends the server's work on it.
  const NOW_AND_THEN_MS = 400;
  const SLOW_MS = 500;
  let busy = false;
  let waiting = false;
  let asked = null; // {start, stop} of the plan that is waited for
  function overtake() {
    if (!asked || !waiting) return;
    const left = SLOW_MS - (performance.now() - asked.start);
    if (left > 0) setTimeout(overtake, left);
    else asked.stop.abort();
  }
  async function replan() {
    waiting = true;
    if (busy) return overtake();
    busy = true;
    let drawn = performance.now();
    try {
      while (waiting) {
        waiting = false;
        const start = performance.now();
        const fields = { ...changed };
        asked = { start, stop: new AbortController() };
        let data;
        try {
          data = await ask("plan", fields, asked.stop.signal);
        } catch (error) {
          if (error.name === "AbortError") continue;
          throw error;
        } finally {
          asked = null;
        }
        refuse(data.error);
        if (data.error) continue;
        if (unplanned) {
          // This page has nothing to show a plan with.
          location.replace(`/?${new URLSearchParams({ token, fields: JSON.stringify(fields) })}`);
          return;
        }
        window.padgen.figures(data);
        window.padgen.tookMs = performance.now() - start;
        document.dispatchEvent(new Event("padgen-figures"));
        await window.padgen.painted();
        if (waiting && performance.now() - drawn < NOW_AND_THEN_MS) continue;
        await window.padgen.follow(await ask("scene", fields), () => waiting);
        drawn = performance.now();
      }
    } catch {
      refuse({ where: "", message: "padgen explore does not answer; is it still running?" });
    }
    busy = false;
    document.dispatchEvent(new Event("padgen-planned"));
  }

  // A refusal is shown above the form and beside the field that it is about; the last plan that works stays in sight.
  function refuse(error) {
    status.textContent = error ? `${error.where ? `${error.where}: ` : ""}${error.message}` : "";
    status.hidden = !error;
    document.body.classList.toggle("refused", Boolean(error));
    if (unplanned) document.getElementById("verdict").textContent = `No plan. ${status.textContent}`;
    for (const [name, control] of Object.entries(controls)) {
      const own = error && (error.where === name || error.where.startsWith(`${name}.`) || error.where.startsWith(`${name}[`));
      control.told.textContent = own ? error.message : "";
      control.told.hidden = !own;
      if (own) control.input.setAttribute("aria-invalid", "true");
      else control.input.removeAttribute("aria-invalid");
    }
  }

  // Labels are words with their unit; most follow from the field's name.
  const LABELS = {
    q_min: "smallest Q",
    delta_y: "ON over OFF asked, as a ratio",
    band_hz: "band of resonances, Hz",
    print_share: "share of prints that must work",
    glue_mg: "glue per washer, mg",
    grid: "coils: rows, columns",
    reuse: "channels of neighbouring coils",
    level_law: "levels fall as 1/f to the power of",
    tune: "what tunes a beam",
  };
  const UNITS = { mm: "mm", um: "µm", mg: "mg", g: "g", hz: "Hz", s: "s", ms: "ms", w: "W", v: "V", a: "A", ohm: "Ω", mh: "mH", mpa: "MPa", gpa: "GPa", g_per_cm3: "g/cm³", frames_per_s: "frames/s" };
  function labelOf(name) {
    const key = name.split(".").pop();
    if (LABELS[key]) return LABELS[key];
    const unit = Object.keys(UNITS).sort((a, b) => b.length - a.length).find((each) => key.endsWith(`_${each}`));
    const words = (unit ? key.slice(0, -unit.length - 1) : key).replaceAll("_", " ");
    return unit ? `${words}, ${UNITS[unit]}` : words;
  }

  function change(name, value) {
    if (value === undefined || value === null || value === "") delete changed[name];
    else changed[name] = value;
    replan();
  }

  // A slider spans a factor of four around the present value, as the bounds of a field often span six decades.
  function sliderFor(field, low, high, whole, onMove) {
    const slider = make("input", "", { type: "range", min: 0, max: 1000, step: 1 });
    let from, to;
    slider.setTo = (value) => {
      from = value > 0 ? Math.max(low, value / 4) : low;
      to = value > 0 ? Math.min(high, value * 4) : Math.min(high, Math.max(1, low + 1));
      slider.value = from > 0 ? (1000 * Math.log(value / from)) / Math.log(to / from) : (1000 * (value - from)) / (to - from);
    };
    slider.addEventListener("input", () => {
      const share = slider.value / 1000;
      const value = from > 0 ? from * (to / from) ** share : from + (to - from) * share;
      onMove(whole ? Math.round(value) : Number(value.toPrecision(3)));
    });
    return slider;
  }

  function numberField(name, field, value) {
    const low = field.minimum ?? field.exclusiveMinimum ?? -Infinity;
    const high = field.maximum ?? Infinity;
    const whole = field.type === "integer";
    const box = make("input", "", { type: "number", min: low, max: high, step: "any", value: value ?? "" });
    const slider = sliderFor(field, low, high, whole, (moved) => {
      box.value = moved;
      change(name, moved);
    });
    box.addEventListener("change", () => {
      if (box.validity.badInput) return refuse({ where: name, message: "must be a number" });
      if (box.value !== "") slider.setTo(Number(box.value));
      change(name, box.value === "" ? null : Number(box.value));
    });
    if (value === null || value === undefined) slider.disabled = true;
    else slider.setTo(value);
    slider.setAttribute("aria-hidden", "true");
    slider.tabIndex = -1; // the number beside it says the same, and takes the keyboard
    return [box, slider];
  }

  function listField(name, value) {
    const box = make("input", "", { type: "text", value: (value ?? []).join(", ") });
    box.addEventListener("change", () => {
      const entries = box.value.split(",").map((entry) => entry.trim()).filter(Boolean);
      change(name, entries.length ? entries.map((entry) => (Number.isNaN(Number(entry)) ? entry : Number(entry))) : null);
    });
    return [box];
  }

  function wordField(name, words, value) {
    const box = make("select", "");
    for (const word of new Set([value, ...words].filter((each) => each !== null && each !== undefined)))
      box.append(make("option", word, { value: word, selected: word === value }));
    box.addEventListener("change", () => {
      // Another part from a catalogue takes all its own figures.
      for (const key of Object.keys(changed)) if (key.startsWith(`${name}.`)) delete changed[key];
      change(name, box.value);
    });
    return [box];
  }

  function textField(name, value) {
    const box = make("input", "", { type: "text", value: value ?? "" });
    box.addEventListener("change", () => change(name, box.value));
    return [box];
  }

  function numberOrWordField(name, value) {
    const box = make("input", "", { type: "text", value: value ?? "" });
    box.addEventListener("change", () => change(name, Number.isNaN(Number(box.value)) ? box.value : Number(box.value)));
    return [box];
  }

  function flagField(name, value) {
    const box = make("input", "", { type: "checkbox", checked: Boolean(value) });
    box.addEventListener("change", () => change(name, box.checked));
    return [box];
  }

  function inputsFor(name, field, value) {
    if (field.enum) return wordField(name, field.enum, value);
    if (field.type === "number" || field.type === "integer") return numberField(name, field, value);
    if (field.type === "boolean") return flagField(name, value);
    if (field.type === "array") return listField(name, value);
    if (field.anyOf) return numberOrWordField(name, value);
    return textField(name, value);
  }

  function row(name, field, value) {
    const line = make("div", "", { className: "field" });
    const inputs = inputsFor(name, field, value);
    const id = `field-${name}`;
    const told = make("p", "", { className: "told", hidden: true });
    inputs[0].id = id;
    inputs[0].name = name;
    const label = make("label", labelOf(name), { htmlFor: id, title: field.description ?? "" });
    const help = make("small", field.description ?? "", { id: `${id}-help` });
    inputs[0].setAttribute("aria-describedby", help.id);
    line.append(label, ...inputs, help, told);
    controls[name] = { told, input: inputs[0] };
    return line;
  }

  // Tables of the spec fold; the four fields that most specs consist of, and the other top-level ones, stand open.
  function section(title, fields, prefix, own) {
    const part = make("details", "", { open: !prefix });
    part.append(make("summary", title));
    for (const [key, field] of Object.entries(fields)) {
      const name = `${prefix}${key}`;
      const table = field.properties ? field : field.anyOf?.find((each) => each.properties);
      const words = field.anyOf?.find((each) => each.enum)?.enum;
      if (!table) part.append(row(name, field, own?.[key]));
      else {
        const inner = section(key.replaceAll("_", " "), table.properties, `${name}.`, own?.[key]);
        inner.open = false;
        if (words) {
          const shown = own?.[key]?.name ?? own?.[key]?.[Object.keys(table.properties).find((each) => table.properties[each].enum)];
          inner.querySelector("summary").after(row(name, { enum: words, description: "take another" }, shown));
        }
        tables.append(inner);
      }
    }
    return part;
  }

  const live = document.getElementById("live");
  const form = make("form", "", { noValidate: true });
  const tables = make("div", "");
  const status = make("p", "", { className: "status", hidden: true });
  status.setAttribute("role", "alert");
  const job = make("p", "", { className: "job" });
  job.setAttribute("role", "status");
  const buttons = make("div", "", { className: "buttons" });
  const save = make("button", "Write the spec", { type: "button" });
  const build = make("button", "Build the pad", { type: "button" });
  const report = make("a", "Show its report", { href: `/report?token=${encodeURIComponent(token)}`, target: "_blank", hidden: true });
  const pad = make("a", "See the pad", { href: "#view", className: "only-narrow" });
  buttons.append(save, build, report, pad);
  form.append(make("h2", "Spec"), status, buttons, job, section("the pad", schema.properties, "", values), tables);
  form.addEventListener("submit", (event) => event.preventDefault());
  live.append(form);
  live.hidden = false;
  document.body.classList.add("live");
  document.getElementById("verdict").setAttribute("aria-live", "polite");
  if (unplanned) {
    document.body.classList.add("unplanned");
    document.getElementById("name").textContent = values.name;
    refuse(unplanned);
  }

  save.addEventListener("click", async () => {
    const data = await ask("save", changed);
    refuse(data.error);
    if (!data.error) job.textContent = `written: ${data.written}`;
  });
  build.addEventListener("click", async () => {
    report.hidden = true;
    let data = await ask("build", changed);
    refuse(data.error);
    if (data.error) return;
    build.disabled = true;
    while (!data.done) {
      job.textContent = `${data.steps.at(-1) ?? "starting"} …`;
      await new Promise((resolve) => setTimeout(resolve, 250));
      data = await ask("progress", {});
    }
    build.disabled = false;
    refuse(data.error);
    job.textContent = data.error ? "not built" : data.steps.at(-1);
    report.hidden = !data.report;
  });
})();
