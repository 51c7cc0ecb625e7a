// The graph: who says what to whom. Nodes and topics are boxes in columns of their own, so that no words overlap.

import { el, plain, say } from "../dom.js";
import { link } from "../link.js";
import { panel } from "../panel.js";
import { robot } from "../robot.js";

const SVG = "http://www.w3.org/2000/svg";
const QUIET = ["log", "parameter_events", "diagnostics"];
const [HIGH, DOWN, GAP, EDGE] = [24, 34, 56, 10];
/** How far an arrow that leads back reaches to both sides, and down. */
const LOOP = 40;
/** How wide a sign is about, and how many of them are shown. */
const SIGN = 7;
const LONGEST = 28;
/** More nobody can read. */
const MOST = 150;

/** The panel of the graph. */
export function graph() {
  const all = el("input", { type: "checkbox", onchange: () => show() });
  const place = el("div", { class: "scroll", tabindex: 0, role: "group", "aria-label": "Graph" });
  const left = el("span", { class: "age" });
  let before = "";

  function show() {
    const found = robot.topics.filter((one) => isShown(one, all.checked));
    const topics = found.slice(0, MOST);
    say(left, found.length > MOST ? `${found.length - MOST} more topics are not drawn` : "");
    const text = JSON.stringify(topics.map(({ key, publishers, subscribers }) => [key, publishers, subscribers]));
    if (text === before) return;
    before = text;
    place.replaceChildren(picture(topics));
  }
  link.on("picture", show);
  robot.onChange(show);
  return panel("graph", "Graph", [left, el("label", {}, all, "dead ends, too")], place);
}

function isShown(topic, withEnds) {
  if (QUIET.includes(topic.key.split("/").at(-1))) return false;
  return withEnds || (topic.publishers.length > 0 && topic.subscribers.length > 0);
}

/** Boxes by name, each with its successors: nodes by their full names, topics by their keys. */
function boxesOf(topics) {
  const boxes = new Map();
  const of = (name, kind) => {
    if (!boxes.has(name)) boxes.set(name, { name, kind, to: [], from: [] });
    return boxes.get(name);
  };
  for (const topic of topics) {
    const middle = of(` ${topic.key}`, "topic"); // no node is called so
    const said = (from, to) => {
      from.to.push(to);
      to.from.push(from);
    };
    topic.publishers.forEach((name) => said(of(name, "node"), middle));
    topic.subscribers.forEach((name) => said(middle, of(name, "node")));
  }
  return [...boxes.values()];
}

/** The column of each box: one more than the highest before it; arrows that lead back do not count. */
function place(boxes) {
  const open = new Set();
  const visit = (box) => {
    if (box.column !== undefined) return box.column;
    if (open.has(box)) return -1;
    open.add(box);
    box.column = 1 + Math.max(-1, ...box.from.map(visit));
    open.delete(box);
    return box.column;
  };
  boxes.forEach(visit);
  const columns = [];
  for (const box of boxes) (columns[box.column] ??= []).push(box);
  const filled = columns.filter(Boolean);
  filled.forEach((column) => column.forEach((box, row) => { box.row = row; }));
  // Each box near those that it hangs together with, a few times to and fro.
  for (let turn = 0; turn < 6; turn++) {
    const order = turn % 2 ? [...filled].reverse() : filled;
    for (const column of order) {
      for (const box of column) {
        const near = turn % 2 ? box.to : box.from;
        box.wish = near.length ? near.reduce((sum, one) => sum + one.row, 0) / near.length : box.row;
      }
      column.sort((a, b) => a.wish - b.wish).forEach((box, row) => { box.row = row; });
    }
  }
  return filled;
}

function picture(topics) {
  const columns = place(boxesOf(topics));
  const tallest = Math.max(1, ...columns.map((column) => column.length));
  const goesBack = columns.flat().some((from) => from.to.some((to) => to.column <= from.column));
  const room = goesBack ? LOOP : 0;
  let x = EDGE + room;
  for (const column of columns) {
    for (const box of column) box.words = short(box.name);
    const wide = Math.max(...column.map(({ words }) => words.length)) * SIGN + 16;
    for (const box of column) {
      Object.assign(box, { x, wide, y: EDGE + (box.row + (tallest - column.length) / 2) * DOWN });
    }
    x += wide + GAP;
  }
  const [width, height] = [Math.max(x - GAP + EDGE + room, 2 * EDGE), tallest * DOWN + EDGE + room / 2];
  const boxes = columns.flat();
  const said = boxes.filter(({ kind }) => kind === "topic").map(inWords).join("; ");
  const svg = svgOf("svg", { width, height, viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": plain(said) || "no topics" });
  const marker = svgOf("marker", { id: "head", viewBox: "0 0 8 8", refX: 8, refY: 4, markerWidth: 7, markerHeight: 7, orient: "auto" });
  marker.append(svgOf("path", { class: "tip", d: "M0 0 L8 4 L0 8 z" }));
  svg.append(marker);
  for (const from of boxes) for (const to of from.to) svg.append(arrow(from, to, height - EDGE));
  for (const box of boxes) {
    const title = svgOf("title", {});
    title.textContent = plain(box.kind === "topic" ? inWords(box) : box.name);
    const words = svgOf("text", { x: box.x + box.wide / 2, y: box.y + HIGH / 2 + 4 });
    words.textContent = plain(box.words);
    const group = svgOf("g", { class: box.kind });
    group.append(svgOf("rect", { x: box.x, y: box.y, width: box.wide, height: HIGH, rx: box.kind === "topic" ? HIGH / 2 : 4 }), words, title);
    svg.append(group);
  }
  return svg;
}

function arrow(from, to, low) {
  const [x1, y1, x2, y2] = [from.x + from.wide, from.y + HIGH / 2, to.x, to.y + HIGH / 2];
  const bend = (x2 - x1) / 2;
  const d = x2 > x1
    ? `M${x1} ${y1} C${x1 + bend} ${y1} ${x2 - bend} ${y2} ${x2} ${y2}`
    // One that leads back goes below all boxes.
    : `M${x1} ${y1} C${x1 + LOOP} ${y1} ${x1 + LOOP} ${low} ${x1} ${low} L${x2} ${low} C${x2 - LOOP} ${low} ${x2 - LOOP} ${y2} ${x2} ${y2}`;
  return svgOf("path", { class: "arrow", "marker-end": "url(#head)", d });
}

function inWords({ name, from, to }) {
  const names = (some) => some.map((one) => short(one.name)).join(", ") || "nobody";
  return `${short(name)}: from ${names(from)} to ${names(to)}`;
}

function short(name) {
  const words = name.trim().replace(/^\//, "");
  const own = robot.name && words.startsWith(`${robot.name}/`) ? words.slice(robot.name.length + 1) : words;
  return own.length > LONGEST ? `…${own.slice(1 - LONGEST)}` : own;
}

function svgOf(tag, attributes) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  return made;
}
