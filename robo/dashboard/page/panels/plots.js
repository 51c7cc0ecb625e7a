// Curves of any numbers of messages over time; several at once, with a pause.

import { el, number, say } from "../dom.js";
import { numbers, part, unit } from "../fields.js";
import { link } from "../link.js";
import { panel } from "../panel.js";
import { robot } from "../robot.js";

/** Five minutes of forty a second. */
const MOST_POINTS = 40 * 300;
const MOST_CURVES = 12;
/** Room for numbers beside a curve, pixels. */
const LEFT = 84;
const FIRST = [["odom", "twist.twist.linear.x"], ["odom", "twist.twist.angular.z"]];

/** The panel of plots. */
export function plots() {
  const topic = el("select", { "aria-label": "Topic", onchange: ask });
  const field = el("select", { "aria-label": "Field" });
  const add = el("button", { type: "button", onclick: () => draw(topic.value, field.value) }, "Add");
  const span = el("select", { "aria-label": "Range" }, ...[10, 30, 60, 300].map((s) => el("option", { value: s, selected: s === 30 }, `${s} s`)));
  const pause = el("button", { type: "button", "aria-pressed": "false", onclick: toggle }, "Pause");
  const list = el("div", { class: "curves" });
  const told = el("p", { class: "told", role: "status" });
  const made = panel("plots", "Plots", [topic, field, add, span, pause], told, list);
  let curves = [];
  let paused = null;
  let end = () => {};

  function toggle() {
    paused = paused === null ? link.now : null;
    pause.setAttribute("aria-pressed", String(paused !== null));
    say(pause, paused === null ? "Pause" : "Go on");
  }

  function ask() {
    end();
    field.replaceChildren();
    add.disabled = true;
    say(told, topic.value ? `${topic.value} has said nothing yet` : "");
    if (!topic.value) return;
    end = link.watch(robot.key(topic.value), undefined, (message) => {
      if (message === undefined || message === null) return;
      end();
      const names = numbers(message);
      field.replaceChildren(...names.map((name) => el("option", {}, name)));
      add.disabled = names.length === 0;
      say(told, names.length ? "" : `${topic.value} has no numbers`);
    });
  }

  function draw(topicName, fieldName) {
    if (!topicName || !fieldName) return;
    if (curves.some((one) => one.topic === topicName && one.field === fieldName)) {
      say(told, "that curve is there");
      return;
    }
    if (curves.length >= MOST_CURVES) {
      say(told, `there are ${MOST_CURVES} curves: remove one first`);
      return;
    }
    say(told, "");
    const value = el("span", {}, "–");
    const canvas = el("canvas", { role: "img", "aria-label": `Curve of ${topicName} ${fieldName}` });
    const curve = { topic: topicName, field: fieldName, points: [], canvas, value };
    const remove = el("button", { type: "button", "aria-label": `Remove ${topicName} ${fieldName}`, onclick: () => drop(curve) }, "×");
    curve.place = el("figure", {}, el("figcaption", {}, `${topicName} ${fieldName} `, value, remove), canvas);
    curve.end = link.watch(robot.key(topicName), undefined, (message, { arrived, type }) => {
      curve.unit = unit(type, fieldName);
      const now = message === undefined ? undefined : part(message, fieldName);
      if (typeof now !== "number") return;
      curve.points.push([arrived, now]);
      if (curve.points.length > MOST_POINTS) curve.points.shift();
    });
    curves.push(curve);
    list.append(curve.place);
  }

  function drop(curve) {
    curve.end();
    curve.place.remove();
    curves = curves.filter((one) => one !== curve);
  }

  link.on("picture", () => {
    const there = robot.topics.filter((one) => one.publishers.length).map((one) => one.key.slice(robot.name ? robot.name.length + 1 : 0));
    if (there.join() === [...topic.options].map((one) => one.value).join()) return;
    const before = topic.value;
    topic.replaceChildren(...there.map((name) => el("option", { value: name }, name)));
    topic.value = there.includes(before) ? before : there.includes("odom") ? "odom" : there[0] ?? "";
    if (topic.value !== before) ask();
  });
  robot.onChange(() => {
    // The same of the other robot.
    const before = curves.length ? curves.map((one) => [one.topic, one.field]) : FIRST;
    for (const curve of [...curves]) drop(curve);
    for (const [topicName, fieldName] of before) draw(topicName, fieldName);
  });

  function paintAll() {
    for (const curve of curves) paint(curve, paused ?? link.now, Number(span.value) * 1000);
    setTimeout(() => requestAnimationFrame(paintAll), 100);
  }
  requestAnimationFrame(paintAll);
  return made;
}

function paint({ canvas, points, value, unit: of }, now, span) {
  const box = canvas.getBoundingClientRect();
  if (!box.width) return;
  const ratio = devicePixelRatio;
  if (canvas.width !== Math.round(box.width * ratio) || canvas.height !== Math.round(box.height * ratio)) {
    canvas.width = Math.round(box.width * ratio);
    canvas.height = Math.round(box.height * ratio);
  }
  const shown = points.filter(([at, v]) => at >= now - span && at <= now && Number.isFinite(v));
  const pen = canvas.getContext("2d");
  const style = getComputedStyle(canvas);
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, box.width, box.height);
  const words = (v) => (of ? `${number(v, 3)} ${of}` : number(v, 3));
  say(value, shown.length ? words(shown.at(-1)[1]) : "nothing in this range");
  pen.fillStyle = style.getPropertyValue("--quiet");
  pen.font = "11px system-ui, sans-serif";
  pen.textAlign = "right";
  pen.fillText("now", box.width - 4, box.height - 4);
  pen.textAlign = "left";
  pen.fillText(`−${span / 1000} s`, LEFT, box.height - 4);
  if (!shown.length) return;
  let low = Infinity;
  let high = -Infinity;
  for (const [, v] of shown) {
    low = Math.min(low, v);
    high = Math.max(high, v);
  }
  const room = Math.max((high - low) * 0.1, 1e-3);
  [low, high] = [low - room, high + room];
  const x = (at) => LEFT + ((at - now + span) / span) * (box.width - LEFT);
  const bottom = box.height - 16; // below stands the time
  const y = (v) => bottom - ((v - low) / (high - low)) * bottom;
  pen.fillStyle = pen.strokeStyle = style.getPropertyValue("--text");
  pen.font = "11px system-ui, sans-serif";
  pen.fillText(words(high), 4, 12);
  pen.fillText(words(low), 4, bottom - 2);
  pen.strokeStyle = style.getPropertyValue("--trail");
  pen.lineWidth = 1.5;
  pen.beginPath();
  shown.forEach(([at, v], i) => (i ? pen.lineTo(x(at), y(v)) : pen.moveTo(x(at), y(v))));
  pen.stroke();
}
