// The parameters of a node: sliders and fields with units and ranges; what it refuses stands beside the field.

import { el, say } from "../dom.js";
import { link } from "../link.js";
import { panel } from "../panel.js";
import { robot } from "../robot.js";

/** A slider of fractions reaches at most so many times as far as the value. */
const WIDE = 20;

/** The panel of parameters. */
export function parameters() {
  const node = el("select", { "aria-label": "Node", onchange: load });
  const words = el("input", { type: "search", placeholder: "name", "aria-label": "Name", oninput: filter });
  const list = el("div", { class: "fields scroll" });
  const told = el("p", { class: "told", role: "status" });
  let rows = new Map();
  let uptime = 0;

  async function load() {
    if (!node.value) return;
    const asked = node.value;
    try {
      const found = await link.ask({ do: "parameters", node: asked });
      if (asked !== node.value) return;
      rows = new Map(found.map((one) => [one.name, row(asked, one)]));
      list.replaceChildren(...[...rows.values()].map((one) => one.place));
      say(told, found.length ? "" : "it has no parameters");
      filter();
    } catch (error) {
      if (asked !== node.value) return;
      rows.clear();
      list.replaceChildren();
      say(told, error.message);
    }
  }

  function filter() {
    for (const [name, { place }] of rows) place.hidden = !name.includes(words.value);
  }

  // What others change, and what this page does: the node says it.
  robot.watch("parameter_events", ["system/ParameterEvent"], (event) => {
    if (event.node !== node.value) return;
    for (const { name, value } of event.changed_parameters) rows.get(name)?.follow(value);
    if (event.new_parameters.length || event.deleted_parameters.length) load();
  });
  link.on("welcome", () => load());
  link.on("picture", () => {
    const ready = robot.nodes.filter((one) => one.state === "ready");
    const there = ready.map((one) => one.node);
    // One that has begun anew has its values from the start.
    const now = ready.find((one) => one.node === node.value)?.uptime ?? 0;
    const isNew = now < uptime;
    uptime = now;
    if (there.join() === [...node.options].map((one) => one.value).join()) {
      if (isNew) load();
      return;
    }
    const before = node.value;
    node.replaceChildren(...there.map((name) => el("option", { value: name }, name.split("/").at(-1))));
    node.value = there.includes(before) ? before : there[0] ?? "";
    if (node.value !== before || isNew) load();
  });
  robot.onChange(() => {
    node.replaceChildren();
    rows.clear();
    list.replaceChildren();
  });
  return panel("parameters", "Parameters", [node, words, el("button", { type: "button", onclick: load, "aria-label": "Ask for the values again" }, "Again")], told, list);
}

function row(node, one) {
  const id = `parameter-${one.name}`;
  const refusal = el("span", { class: "refusal", role: "alert", id: `${id}-refusal` });
  const kind = kindOf(one);
  const field = control(one, id, kind);
  const slide = slider(one, kind, field);
  slide?.addEventListener("change", () => set());
  field.addEventListener("change", () => set());

  let said = one.value;
  let asking = 0;
  let shown = field.value; // what it had before somebody began to type

  function show(value) {
    if (field.type === "checkbox") field.checked = value;
    else field.value = written(value, kind);
    if (slide) slide.value = value;
    shown = field.value;
  }

  async function set() {
    let value;
    try {
      value = field.type === "checkbox" ? field.checked : read(field.value, kind);
    } catch (error) {
      say(refusal, error.message);
      return;
    }
    asking++;
    try {
      await link.ask({ do: "set", node, values: { [one.name]: value } });
      said = value;
      say(refusal, "");
    } catch (error) {
      say(refusal, error.message);
    }
    if (--asking === 0) show(said); // else a newer one is on its way
  }

  /** The node says that it has another value. Who is typing goes on, and is told. */
  function follow(value) {
    const isNews = JSON.stringify(value) !== JSON.stringify(said);
    said = value;
    if (asking || !isNews) return; // it is what has been set here
    const isTyping = document.activeElement === field && field.type !== "checkbox" && field.value !== shown;
    if (isTyping) say(refusal, `somebody has set it to ${written(value, kind)}`);
    else {
      show(value);
      say(refusal, "");
    }
  }
  field.addEventListener("focus", () => { shown = field.value; });
  field.setAttribute("aria-describedby", `${id}-about ${id}-refusal`);

  const about = [one.unit, rangeText(one.constraints), one.read_only ? "read-only" : ""].filter(Boolean).join(", ");
  return {
    place: el(
      "div", { class: "field" },
      el("label", { for: id }, one.name),
      el("span", { class: "controls" }, slide, field, one.unit ? el("span", { class: "unit" }, one.unit) : null),
      el("small", { id: `${id}-about` }, [one.description, about].filter(Boolean).join(" · ")),
      refusal,
    ),
    follow,
  };
}

/** A slider beside a field of numbers; none where its range is so wide that a finger would jump over what makes sense. */
function slider(one, kind, field) {
  const { minimum, maximum } = range(one.constraints);
  if (kind !== "number" || minimum === undefined || maximum === undefined) return null;
  const span = maximum - minimum;
  const isInt = one.type === "int";
  if (!(span > 0 && span <= (isInt ? 2000 : WIDE * Math.max(1, Math.abs(one.value))))) return null;
  const step = isInt ? 1 : 10 ** Math.floor(Math.log10(span / 100));
  const rounded = (value) => Math.min(maximum, Math.max(minimum, Number((Math.round(value / step) * step).toPrecision(12))));
  const made = el("input", {
    type: "range", min: minimum, max: maximum, step: isInt ? 1 : "any", value: one.value,
    disabled: one.read_only || !link.drives, "aria-label": `${one.name}, slider`,
    oninput: () => { field.value = String(rounded(Number(made.value))); },
  });
  return made;
}

function control(one, id, kind) {
  const disabled = one.read_only || !link.drives;
  if (kind === "flag") return el("input", { id, type: "checkbox", checked: one.value, disabled });
  return el("input", { id, type: kind === "number" ? "number" : "text", step: one.type === "int" ? 1 : "any", value: written(one.value, kind), disabled });
}

function written(value, kind) {
  return kind === "text" ? String(value) : typeof value === "number" ? String(value) : JSON.stringify(value);
}

/** How a parameter is shown and read: numbers, words, or as JSON what is a list, a map, or may be of several types. */
function kindOf({ type, value }) {
  if (type === "int" || type === "float") return "number";
  if (type === "bool") return "flag";
  return type === "str" || typeof value === "string" ? "text" : "data";
}

function read(text, kind) {
  if (kind === "text") return text;
  if (kind === "number") {
    if (text.trim() === "" || !Number.isFinite(Number(text))) throw new Error("that is no number");
    return Number(text);
  }
  try {
    return JSON.parse(text);
  } catch (error) {
    throw new Error('write it as JSON, such as ["a", "b"]');
  }
}

function range(constraints) {
  const above = constraints.ge ?? constraints.gt;
  const below = constraints.le ?? constraints.lt;
  return { minimum: above, maximum: below };
}

function rangeText(constraints) {
  const signs = { ge: "≥", gt: ">", le: "≤", lt: "<" };
  return Object.entries(constraints).map(([name, value]) => `${signs[name] ?? name} ${value}`).join(", ");
}
