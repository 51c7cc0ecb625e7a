// The map: where the robot is and was, what it sees and plans, what its safety watches. Metres, x to the right.

import { age, el, number, say } from "../dom.js";
import { link } from "../link.js";
import { ageOf, panel } from "../panel.js";
import { STALE, paint } from "../painting.js";
import { chain } from "../plane.js";
import { robot } from "../robot.js";
import { empty, gridOf, marked, pathOf, poseOf, scanOf } from "../things.js";

/** At most so often it is drawn, ms: there are other things to do. */
const FRAME = 50;
const TRAIL = 4000;
const STEP = 0.05;
/** An older scan is drawn no more, ms. */
const GONE = 10_000;

/** The panel of the map. */
export function map() {
  const canvas = el("canvas", { tabindex: 0, role: "img", "aria-label": "Map of the robot and what it sees" });
  const where = el("p", { class: "told" });
  const unplaced = el("p", { class: "told", role: "status" });
  const ageLine = el("p", { class: "told" });
  const follow = el("input", { type: "checkbox", id: "follow", checked: true });
  const goal = el("input", { type: "checkbox", id: "goal" });
  const seen = { at: null };
  const made = panel(
    "map",
    "Map",
    [
      ageOf(() => seen.at),
      el("label", {}, follow, "follow"),
      el("label", {}, goal, "click = waypoint"),
      button("+", "Closer", () => zoom(1.25)),
      button("−", "Farther", () => zoom(0.8)),
      button("⟲", "Clear the trail", () => { things.trail = []; draw(); }),
    ],
    canvas,
    el("div", { class: "below" }, where, unplaced, ageLine),
  );

  const view = { scale: 40, x: 0, y: 0 };
  let things = empty();
  let dirty = false;
  let drawnAt = -Infinity;

  function draw() {
    if (dirty) return;
    dirty = true;
    const wait = Math.max(0, drawnAt + FRAME - performance.now());
    setTimeout(() => requestAnimationFrame(() => {
      dirty = false;
      drawnAt = performance.now();
      if (link.now - things.arrived.scan > GONE) things.scan = null;
      link.guarded(() => paint(canvas, view, things, follow.checked, link.now));
      const lost = [...things.unplaced];
      say(unplaced, lost.length ? `not drawn, no transform from ${lost.join(", ")}` : "");
      say(ageLine, ages());
      canvas.dataset.drawn = String(Number(canvas.dataset.drawn ?? 0) + 1);
    }), wait);
  }

  /** Of all that is drawn and not new, how old it is: a scan comes all the time, the others are said once. */
  function ages() {
    const old = (what) => link.now - things.arrived[what];
    ageLine.classList.toggle("stale", old("scan") > STALE);
    const scan = old("scan") > GONE ? `no scan for ${age(old("scan"))}` : `scan ${age(old("scan"))} old`;
    const others = Object.keys(things.arrived).filter((what) => what !== "scan" && old(what) > STALE);
    return [...(old("scan") > STALE ? [scan] : []), ...others.map((what) => `${what} ${age(old(what))} old`)].join(", ");
  }
  setInterval(() => Object.keys(things.arrived).length && draw(), 1000); // ages go on

  function zoom(factor) {
    view.scale = Math.min(2000, Math.max(0.5, view.scale * factor));
    draw();
  }

  robot.onChange(() => {
    things = empty();
    seen.at = null;
    link.watchFrames(robot.name);
    draw();
  });
  robot.watch("odom", ["nav/Odometry"], (message, { arrived }) => {
    const pose = poseOf(message.pose.pose);
    if (pose === null) return;
    things.pose = { ...pose, frame: message.header.frame_id || "odom" };
    things.base = message.child_frame_id || "base_link";
    const last = things.trail.at(-1);
    if (!last || Math.hypot(last[0] - pose.x, last[1] - pose.y) > STEP) {
      things.trail.push([pose.x, pose.y]);
      if (things.trail.length > TRAIL) things.trail.shift();
    }
    seen.at = arrived;
    say(where, `x ${number(pose.x)} m, y ${number(pose.y)} m, heading ${number((pose.heading * 180) / Math.PI, 0)}°`);
    draw();
  });
  /** Draw what a topic says; `take` raises where that cannot be drawn. */
  const shown = (topic, type, what, take) => robot.watch(topic, [type], (message, { arrived }) => {
    take(message);
    things.arrived[what] = arrived;
    draw();
  });
  shown("scan", "sensor/LaserScan", "scan", (message) => { things.scan = scanOf(message); });
  shown("map", "nav/OccupancyGrid", "map", (message) => { things.grid = gridOf(message); });
  for (const topic of ["path", "plan", "waypoints"]) {
    shown(topic, "nav/Path", topic, (message) => { things.paths[topic] = pathOf(message); });
  }
  shown("safety_zones", "visualization/MarkerArray", "zones", ({ markers }) => { things.zones = marked(things.zones, markers); });
  link.on("frames", (news) => {
    if (news.robot !== (robot.name ?? "")) return;
    things.frames = news.frames;
    draw();
  });

  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(event.deltaY < 0 ? 1.15 : 1 / 1.15);
  }, { passive: false });
  let drag = null;
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    drag = { x: event.clientX, y: event.clientY, far: 0 };
  });
  canvas.addEventListener("pointermove", (event) => {
    if (drag === null) return;
    const [x, y] = [event.clientX - drag.x, event.clientY - drag.y];
    drag = { x: event.clientX, y: event.clientY, far: drag.far + Math.hypot(x, y) };
    if (drag.far < 5) return;
    follow.checked = false;
    view.x -= x / view.scale;
    view.y += y / view.scale;
    draw();
  });
  canvas.addEventListener("pointerup", (event) => {
    if (drag !== null && drag.far < 5 && goal.checked) send(event);
    drag = null;
  });
  canvas.addEventListener("pointercancel", () => { drag = null; });
  canvas.addEventListener("keydown", (event) => {
    const steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    if (event.key === "+" || event.key === "-") zoom(event.key === "+" ? 1.25 : 0.8);
    else if (event.key in steps) {
      follow.checked = false;
      view.x += (steps[event.key][0] * 40) / view.scale;
      view.y += (steps[event.key][1] * 40) / view.scale;
      draw();
    } else return;
    event.preventDefault();
  });
  new ResizeObserver(draw).observe(canvas);
  link.on("welcome", () => { goal.disabled = !link.drives; });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);

  async function send(event) {
    if (!robot.isThere) {
      say(unplaced, `no waypoint: ${robot.absence}`);
      return;
    }
    const box = canvas.getBoundingClientRect();
    const x = view.x + (event.clientX - box.left - box.width / 2) / view.scale;
    const y = view.y - (event.clientY - box.top - box.height / 2) / view.scale;
    const root = chain(things.pose?.frame ?? "odom", things)?.root ?? "odom";
    const pose = { header: { frame_id: root }, pose: { position: { x, y, z: 0 } } };
    try {
      await link.ask({
        do: "publish",
        topic: robot.key("waypoints"),
        type: "nav/Path",
        message: { header: pose.header, poses: [pose] },
      });
      say(unplaced, `waypoint x ${number(x)} m, y ${number(y)} m is said`);
    } catch (error) {
      say(unplaced, `no waypoint: ${error.message}`);
    }
  }
  return made;
}

function button(sign, name, onclick) {
  return el("button", { type: "button", "aria-label": name, title: name, onclick }, sign);
}
