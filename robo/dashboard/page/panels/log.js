// The log of all nodes, by level, node and words.

import { clock, el } from "../dom.js";
import { link } from "../link.js";
import { panel } from "../panel.js";
import { robot } from "../robot.js";

const LEVELS = ["DEBUG", "INFO", "WARN", "ERROR", "FATAL"];
const MOST = 1000;

/** The panel of the log. */
export function log() {
  const level = el("select", { "aria-label": "Level and above", onchange: show }, ...LEVELS.map((name) => el("option", { selected: name === "INFO" }, name)));
  const node = el("input", { type: "search", placeholder: "node", "aria-label": "Node", oninput: show });
  const words = el("input", { type: "search", placeholder: "words", "aria-label": "Words", oninput: show });
  const list = el("ol", { class: "lines" });
  const scroll = el("div", { class: "scroll", tabindex: 0, role: "log", "aria-live": "off", "aria-label": "Lines of the log" }, list);
  let all = [];

  const isWanted = (line) =>
    robot.has(line.robot, "") &&
    (LEVELS.indexOf(line.level) < 0 || LEVELS.indexOf(line.level) >= LEVELS.indexOf(level.value)) &&
    line.node.toLowerCase().includes(node.value.toLowerCase()) &&
    line.message.toLowerCase().includes(words.value.toLowerCase());

  function add(lines) {
    const atEnd = scroll.scrollTop + scroll.clientHeight >= scroll.scrollHeight - 20;
    list.append(...lines.filter(isWanted).slice(-MOST).map(row));
    while (list.childElementCount > MOST) list.firstChild.remove();
    if (atEnd) scroll.scrollTop = scroll.scrollHeight;
  }

  function show() {
    list.replaceChildren();
    add(all);
  }

  let first = true;
  link.on("welcome", () => { first = true; });
  link.on("lines", ({ lines }) => {
    // What the server remembers: after a lost link it says it again. And of a robot that it has met late, its past.
    const isLate = first || lines[0]?.time < all.at(-1)?.time;
    all = first ? lines : [...all, ...lines];
    first = false;
    all = all.sort((a, b) => a.time - b.time).slice(-MOST);
    if (isLate) show();
    else add(lines);
  });
  robot.onChange(show);
  return panel("log", "Log", [level, node, words], scroll);
}

function row(line) {
  return el(
    "li",
    { "data-level": { WARN: "warn", ERROR: "error", FATAL: "error" }[line.level] ?? "" },
    el("time", {}, clock(line.time)),
    el("b", {}, line.node),
    el("span", {}, line.level ? `${line.level} ${line.message}` : line.message),
  );
}
