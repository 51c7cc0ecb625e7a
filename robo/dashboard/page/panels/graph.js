// The graph: who says what to whom. Nodes in columns by how far they are from where data begins.

import { el } from "../dom.js";
import { link } from "../link.js";
import { panel } from "../panel.js";
import { robot } from "../robot.js";

const SVG = "http://www.w3.org/2000/svg";
const QUIET = ["log", "parameter_events", "diagnostics"];
const [WIDE, HIGH, ACROSS, DOWN] = [150, 26, 230, 44];

/** The panel of the graph. */
export function graph() {
  const place = el("div", { class: "scroll", tabindex: 0 });
  let before = "";

  function show() {
    const arrows = arrowsOf(robot.topics);
    const text = JSON.stringify(arrows);
    if (text === before) return;
    before = text;
    place.replaceChildren(picture(arrows));
  }
  link.on("picture", show);
  robot.onChange(show);
  return panel("graph", "Graph", [], place);
}

function arrowsOf(topics) {
  const found = [];
  for (const topic of topics) {
    const name = topic.key.split("/").at(-1);
    if (QUIET.includes(name)) continue;
    for (const from of topic.publishers) {
      for (const to of topic.subscribers) if (from !== to) found.push({ from, to, name });
    }
  }
  return found;
}

/** The column of each node: one more than the highest before it; arrows that lead back do not count. */
function columns(names, arrows) {
  const column = new Map();
  const open = new Set();
  const of = (name) => {
    if (column.has(name)) return column.get(name);
    if (open.has(name)) return -1;
    open.add(name);
    const found = 1 + Math.max(-1, ...arrows.filter(({ to }) => to === name).map(({ from }) => of(from)));
    open.delete(name);
    column.set(name, found);
    return found;
  };
  names.forEach(of);
  return column;
}

function picture(arrows) {
  const names = [...new Set(arrows.flatMap(({ from, to }) => [from, to]))].sort();
  const column = columns(names, arrows);
  const filled = [];
  const at = new Map();
  for (const name of names) {
    const x = column.get(name);
    filled[x] = (filled[x] ?? 0) + 1;
    at.set(name, { x: 10 + x * ACROSS, y: 10 + (filled[x] - 1) * DOWN + (x % 2) * 16 });
  }
  const width = 20 + Math.max(0, ...[...at.values()].map(({ x }) => x)) + WIDE;
  const height = 20 + Math.max(0, ...[...at.values()].map(({ y }) => y)) + HIGH;
  const said = arrows.map(({ from, to, name }) => `${from} says ${name} to ${to}`).join("; ");
  const svg = svgOf("svg", { width, height, viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": said || "no topics" });
  const pairs = new Map();
  for (const { from, to, name } of arrows) {
    const pair = `${from} ${to}`;
    if (!pairs.has(pair)) pairs.set(pair, { from, to, names: [] });
    pairs.get(pair).names.push(name);
  }
  for (const { from, to, names: topics } of pairs.values()) {
    const [a, b] = [at.get(from), at.get(to)];
    const [x1, y1, x2, y2] = [a.x + WIDE, a.y + HIGH / 2, b.x, b.y + HIGH / 2];
    const back = x2 <= x1 ? 60 : 40;
    const line = svgOf("path", { class: "arrow", d: `M${x1} ${y1} C${x1 + back} ${y1} ${x2 - back} ${y2} ${x2} ${y2}` });
    const title = svgOf("title", {});
    title.textContent = topics.join(", ");
    line.append(title);
    const words = svgOf("text", { class: "topic", x: (x1 + x2) / 2, y: (y1 + y2) / 2 - 3 });
    words.textContent = topics.length > 1 ? `${topics[0]} +${topics.length - 1}` : topics[0];
    svg.append(line, words);
  }
  for (const [name, { x, y }] of at) {
    const words = svgOf("text", { class: "node", x: x + WIDE / 2, y: y + HIGH / 2 + 4 });
    words.textContent = name.split("/").at(-1);
    svg.append(svgOf("rect", { x, y, width: WIDE, height: HIGH, rx: 5 }), words);
  }
  return svg;
}

function svgOf(tag, attributes) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  return made;
}
