// The nodes: how each does, what it takes; starting, stopping, and why it is as it is.

import { Rows, age, el, number, plain, say, size } from "../dom.js";
import { link } from "../link.js";
import { ageOf, panel } from "../panel.js";
import { levelOf, robot } from "../robot.js";

/** The panel of nodes. */
export function nodes() {
  const body = el("tbody");
  const told = el("pre", { class: "told", role: "status" });
  const head = ["Node", "State", "Health", "CPU", "Memory", "Restarts", "Up", ""].map((name) => el("th", { scope: "col" }, name));
  const made = panel("nodes", "Nodes", [ageOf(() => robot.pictureAt, 3500)], el("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": "All nodes" }, el("table", {}, el("thead", {}, el("tr", {}, ...head)), body)), told);
  const rows = new Rows(body, (node) => node.node, make, fill);

  function make(node) {
    const cells = Array.from({ length: 7 }, () => el("td"));
    const name = node.node.replace(`/${robot.name}/`, "");
    const act = (verb) => el("button", { type: "button", onclick: () => command(verb, row.node), "aria-label": `${verb} ${name}` }, verb);
    const acts = Object.fromEntries(["why", "restart", "stop", "start"].map((verb) => [verb, act(verb)]));
    const row = el("tr", {}, ...cells, el("td", { class: "acts" }, ...Object.values(acts)));
    Object.assign(row, { cells_: cells, acts, node });
    return row;
  }

  function fill(row, node) {
    row.node = node;
    const words = [
      node.node.replace(`/${robot.name}/`, ""),
      node.state,
      node.health ?? "",
      node.cpu === null ? "–" : `${number(node.cpu, 1)} %`,
      size(node.memory),
      node.restarts === null ? "–" : String(node.restarts),
      node.uptime === null ? "–" : age(node.uptime * 1000),
    ];
    words.forEach((text, i) => say(row.cells_[i], text));
    row.cells_[1].title = plain(node.reason);
    row.cells_[2].title = plain(node.trouble);
    row.dataset.level = levelOf(node);
    const runs = node.pid !== null;
    const [start, stop] = [row.acts.start, row.acts.stop];
    const focused = document.activeElement;
    start.hidden = runs;
    stop.hidden = row.acts.restart.hidden = !runs;
    // Who has pressed a button that is gone is at the one that has come for it.
    if (focused?.hidden && row.contains(focused)) row.focusOn = runs ? stop : start;
    for (const verb of ["start", "stop", "restart"]) row.acts[verb].disabled = !link.drives || node.robot === "";
    row.focusOn?.focus();
    row.focusOn = null;
  }

  async function command(verb, node) {
    say(told, `${verb} ${node.node} …`);
    try {
      const answer = await link.ask({ do: "command", robot: node.robot || robot.name, verb, node: node.node });
      say(told, verb === "why" ? answer.map(explained).join("\n") : `${verb}: ${answer.nodes.join(", ") || "nothing to do"}`);
    } catch (error) {
      say(told, `${verb} ${node.node}: ${error.message}`);
    }
  }

  link.on("picture", () => rows.show(robot.nodes));
  robot.onChange(() => rows.show(robot.nodes));
  return made;
}

function explained(one) {
  const { node, state, reason, trouble } = one.process;
  const lines = [`${node}: ${state}${reason ? `, ${reason}` : ""}`];
  if (trouble) lines.push(`  ${trouble}`);
  for (const need of one.unmet_needs) lines.push(`  waits for ${need}`);
  for (const input of one.inputs) lines.push(`  input ${words(input)}`);
  for (const exit of one.exits) lines.push(`  ended: ${words(exit)}`);
  if (one.callback_errors) lines.push(`  callbacks have failed ${one.callback_errors} times`);
  if (one.next_start !== null) lines.push(`  is started again in ${number(one.next_start, 1)} s`);
  return lines.join("\n");
}

/** Units of what is said there. */
const UNITS = { age: " s", rate: " Hz", uptime: " s" };

/** A part of an explanation in words: what is said of it, name by name. */
function words(part) {
  const said = Object.entries(part).filter(([, value]) => ![null, "", 0, false].includes(value) && !(Array.isArray(value) && !value.length));
  return said.map(([name, value]) => `${name.replaceAll("_", " ")} ${typeof value === "number" ? number(value, Number.isInteger(value) ? 0 : 2) + (UNITS[name] ?? "") : Array.isArray(value) ? value.map(String).join(", ") : value}`).join(", ");
}
