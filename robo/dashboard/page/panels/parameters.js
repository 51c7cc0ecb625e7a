// The parameters of a node: sliders and fields with units and ranges; what it refuses stands beside the field.

import { el, say } from "../dom.js";
import { link } from "../link.js";
import { panel } from "../panel.js";
import { robot } from "../robot.js";

/** The panel of parameters. */
export function parameters() {
  const node = el("select", { "aria-label": "Node", onchange: load });
  const words = el("input", { type: "search", placeholder: "name", "aria-label": "Name", oninput: filter });
  const list = el("div", { class: "fields scroll" });
  const told = el("p", { class: "told", role: "status" });
  let rows = new Map();

  async function load() {
    if (!node.value) return;
    const asked = node.value;
    try {
      const found = await link.ask({ do: "parameters", node: asked });
      if (asked !== node.value) return;
      rows = new Map(found.map((one) => [one.name, row(asked, one)]));
      list.replaceChildren(...[...rows.values()].map((one) => one.place));
      say(told, "");
      filter();
    } catch (error) {
      rows.clear();
      list.replaceChildren();
      say(told, error.message);
    }
  }

  function filter() {
    for (const [name, { place }] of rows) place.hidden = !name.includes(words.value);
  }

  robot.watch("parameter_events", (event) => {
    if (event.node !== node.value) return;
    for (const { name, value } of event.changed_parameters ?? []) rows.get(name)?.show(plain(value));
  });
  link.on("picture", () => {
    const there = robot.nodes.filter((one) => one.state === "ready").map((one) => one.node);
    if (there.join() === [...node.options].map((one) => one.value).join()) return;
    const before = node.value;
    node.replaceChildren(...there.map((name) => el("option", { value: name }, name.split("/").at(-1))));
    node.value = there.includes(before) ? before : there[0] ?? "";
    if (node.value !== before) load();
  });
  robot.onChange(() => {
    node.replaceChildren();
    list.replaceChildren();
  });
  return panel("parameters", "Parameters", [node, words, el("button", { type: "button", onclick: load }, "Again")], told, list);
}

/** A value as ROS's ParameterValue says it, or as it is. */
function plain(value) {
  return value;
}

function row(node, one) {
  const id = `parameter-${one.name}`;
  const refusal = el("span", { class: "refusal", role: "alert" });
  const { minimum, maximum } = range(one.constraints);
  const isNumber = ["int", "float"].includes(one.type);
  const field = control(one, id, isNumber);
  const slide = isNumber && minimum !== undefined && maximum !== undefined && maximum - minimum <= 1e4
    ? el("input", {
        type: "range", min: minimum, max: maximum, step: one.type === "int" ? 1 : (maximum - minimum) / 200, value: one.value,
        disabled: one.read_only || !link.drives, "aria-label": `${one.name}, slider`,
        oninput: () => { field.value = slide.value; },
        onchange: () => set(),
      })
    : null;
  field.addEventListener("change", () => set());

  function show(value) {
    if (field.type === "checkbox") field.checked = value;
    else field.value = written(value, one.type);
    if (slide) slide.value = value;
    say(refusal, "");
  }

  let said = one.value;
  async function set() {
    let value;
    try {
      value = field.type === "checkbox" ? field.checked : read(field.value, one.type);
    } catch (error) {
      say(refusal, error.message);
      return;
    }
    try {
      await link.ask({ do: "set", node, values: { [one.name]: value } });
      said = value;
      show(value);
    } catch (error) {
      show(said);
      say(refusal, error.message);
    }
  }

  const about = [one.unit, rangeText(one.constraints), one.read_only ? "read-only" : ""].filter(Boolean).join(", ");
  return {
    place: el(
      "div", { class: "field" },
      el("label", { for: id }, one.name),
      el("span", { class: "controls" }, slide, field, one.unit ? el("span", { class: "unit" }, one.unit) : null),
      el("small", {}, [one.description, about].filter(Boolean).join(" · ")),
      refusal,
    ),
    show: (value) => {
      said = value;
      show(value);
    },
  };
}

function control(one, id, isNumber) {
  const disabled = one.read_only || !link.drives;
  if (one.type === "bool") return el("input", { id, type: "checkbox", checked: one.value, disabled });
  return el("input", { id, type: isNumber ? "number" : "text", step: one.type === "int" ? 1 : "any", value: written(one.value, one.type), disabled });
}

function written(value, type) {
  return type === "str" || typeof value === "number" ? String(value) : JSON.stringify(value);
}

function read(text, type) {
  if (type === "str") return text;
  if (type === "int" || type === "float") {
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
