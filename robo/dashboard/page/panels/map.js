// The map: where the robot is and was, what it sees and plans, what its safety watches. Metres, x to the right.

import { el, number, say } from "../dom.js";
import { link } from "../link.js";
import { ageOf, panel } from "../panel.js";
import { chain, placeOf, yaw } from "../plane.js";
import { robot } from "../robot.js";

/** At most so often it is drawn, ms: there are other things to do. */
const FRAME = 50;
const TRAIL = 4000;
const STEP = 0.05;
/** Kinds of markers, by ROS's numbers, that are drawn. */
const LINE_STRIP = 4;
const LINE_LIST = 5;
const DELETE = 2;
const DELETEALL = 3;
/** Of what strangers may send, no more than can be drawn. */
const MOST_POINTS = 20_000;
const MOST_MARKERS = 500;
const MOST_CELLS = 2 ** 24;

/** The panel of the map. */
export function map() {
  const canvas = el("canvas", { tabindex: 0, role: "img", "aria-label": "Map of the robot and what it sees" });
  const where = el("p", { class: "told" });
  const unplaced = el("p", { class: "told", role: "status" });
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
    el("div", { class: "below" }, where, unplaced),
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
      paint(canvas, view, things, follow.checked);
      const lost = [...things.unplaced];
      say(unplaced, lost.length ? `not drawn, no transform from ${lost.join(", ")}` : "");
      canvas.dataset.drawn = String(Number(canvas.dataset.drawn ?? 0) + 1);
    }), wait);
  }

  function zoom(factor) {
    view.scale = Math.min(2000, Math.max(0.5, view.scale * factor));
    draw();
  }

  robot.onChange(() => {
    things = empty();
    seen.at = null;
    draw();
  });
  robot.watch("odom", ["nav/Odometry"], (message, { arrived }) => {
    const { position, orientation } = message.pose.pose;
    if (!Number.isFinite(position.x + position.y + yaw(orientation))) return;
    things.pose = { x: position.x, y: position.y, heading: yaw(orientation), frame: message.header.frame_id || "odom" };
    things.base = message.child_frame_id || "base_link";
    const last = things.trail.at(-1);
    if (!last || Math.hypot(last[0] - position.x, last[1] - position.y) > STEP) {
      things.trail.push([position.x, position.y]);
      if (things.trail.length > TRAIL) things.trail.shift();
    }
    seen.at = arrived;
    say(where, `x ${number(position.x)} m, y ${number(position.y)} m, heading ${number((things.pose.heading * 180) / Math.PI, 0)}°`);
    draw();
  });
  robot.watch("scan", ["sensor/LaserScan"], (message) => {
    things.scan = message;
    draw();
  });
  robot.watch("map", ["nav/OccupancyGrid"], (message) => {
    things.grid = grid(message);
    draw();
  });
  for (const topic of ["path", "plan", "waypoints"]) {
    robot.watch(topic, ["nav/Path"], (message) => {
      things.paths[topic] = pathOf(message);
      draw();
    });
  }
  robot.watch("safety_zones", ["visualization/MarkerArray"], (message) => {
    things.zones = marked(things.zones, message.markers);
    draw();
  });
  robot.watch("tf", [], () => {});
  robot.watch("tf_static", [], () => {});
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

function empty() {
  return { pose: null, base: "base_link", trail: [], scan: null, grid: null, paths: {}, unplaced: new Set(), zones: new Map(), frames: {} };
}

/** A path as points. */
function pathOf({ header, poses }) {
  const points = poses.slice(0, MOST_POINTS).map(({ pose }) => [pose.position.x, pose.position.y]);
  return { frame: header.frame_id, points: points.filter(([x, y]) => Number.isFinite(x + y)) };
}

/** The markers that are there after some more have come. */
function marked(before, markers) {
  const all = new Map(before);
  for (const marker of markers) {
    const name = `${marker.ns}\n${marker.id}`;
    if (marker.action === DELETEALL) {
      for (const [other, one] of all) if (!marker.ns || one.ns === marker.ns) all.delete(other);
    } else if (marker.action === DELETE) all.delete(name);
    else if (all.size < MOST_MARKERS || all.has(name)) all.set(name, marker);
  }
  return all;
}

/** Draw in a frame of the robot's; nothing where it is not known where that stands. */
function inFrame(pen, frame, things, paintIt) {
  const at = placeOf(frame, things);
  if (at === null) {
    things.unplaced.add(frame);
    return;
  }
  pen.save();
  pen.translate(at.x, at.y);
  pen.rotate(at.heading);
  paintIt();
  pen.restore();
}

/** An occupancy grid as a picture: free cells light, occupied ones dark, unknown ones hardly seen. */
function grid(message) {
  const { width, height, resolution, origin } = message.info;
  const cells = message.data;
  if (!(width > 0 && height > 0 && resolution > 0 && width * height <= MOST_CELLS)) return null;
  if (!ArrayBuffer.isView(cells) || cells.length < width * height) return null;
  const shades = new Uint32Array(256);
  for (let value = 0; value < 256; value++) {
    const shade = 255 - Math.round(Math.min(value, 100) * 2.2);
    shades[value] = value < 128 ? (0xff000000 | (shade << 16) | (shade << 8) | shade) >>> 0 : 0x30808080;
  }
  const picture = new OffscreenCanvas(width, height);
  const pen = picture.getContext("2d");
  const image = pen.createImageData(width, height);
  const pixels = new Uint32Array(image.data.buffer);
  for (let row = 0, from = 0; row < height; row++) {
    const to = (height - 1 - row) * width; // row 0 is the lowest
    for (let column = 0; column < width; column++) pixels[to + column] = shades[cells[from++]];
  }
  pen.putImageData(image, 0, 0);
  return { picture, width: width * resolution, height: height * resolution, origin, frame: message.header.frame_id };
}

function paint(canvas, view, things, following) {
  const box = canvas.getBoundingClientRect();
  const ratio = devicePixelRatio;
  if (canvas.width !== Math.round(box.width * ratio) || canvas.height !== Math.round(box.height * ratio)) {
    canvas.width = Math.round(box.width * ratio);
    canvas.height = Math.round(box.height * ratio);
  }
  things.unplaced = new Set();
  const robotAt = things.pose ? placeOf(things.base, things) : null;
  if (following && robotAt) [view.x, view.y] = [robotAt.x, robotAt.y];
  const color = colors(canvas);
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, box.width, box.height);
  lines(pen, view, box, color);
  // From here on in metres, y upwards.
  pen.setTransform(ratio * view.scale, 0, 0, -ratio * view.scale,
    ratio * (box.width / 2 - view.x * view.scale), ratio * (box.height / 2 + view.y * view.scale));
  const hair = 1 / view.scale;
  if (things.grid) inFrame(pen, things.grid.frame, things, () => floor(pen, things.grid));
  for (const path of Object.values(things.paths)) {
    inFrame(pen, path.frame, things, () => {
      trace(pen, path.points, color.path, 1.5 * hair);
      pen.fillStyle = color.path;
      for (const [x, y] of path.points.length <= 100 ? path.points : []) dot(pen, x, y, 3 * hair);
    });
  }
  inFrame(pen, things.pose?.frame ?? "", things, () => trace(pen, things.trail, color.trail, 2 * hair));
  for (const zone of things.zones.values()) {
    inFrame(pen, zone.header.frame_id, things, () => outline(pen, zone, color, hair));
  }
  if (things.scan) inFrame(pen, things.scan.header.frame_id, things, () => rays(pen, things.scan, color, hair));
  if (robotAt) body(pen, robotAt, color, hair);
}

function floor(pen, { picture, width, height, origin }) {
  pen.translate(origin.position.x, origin.position.y);
  pen.rotate(yaw(origin.orientation));
  pen.scale(1, -1);
  pen.imageSmoothingEnabled = false;
  pen.drawImage(picture, 0, -height, width, height);
}

function colors(canvas) {
  const style = getComputedStyle(canvas);
  const of = (name) => style.getPropertyValue(`--${name}`).trim();
  return Object.fromEntries(["grid", "text", "trail", "path", "scan", "body", "zone"].map((name) => [name, of(name)]));
}

function lines(pen, view, box, color) {
  const step = [0.1, 0.5, 1, 5, 10, 50, 100].find((one) => one * view.scale >= 25) ?? 500;
  pen.strokeStyle = color.grid;
  pen.lineWidth = 1;
  pen.beginPath();
  const left = view.x - box.width / 2 / view.scale;
  const low = view.y - box.height / 2 / view.scale;
  for (let x = Math.ceil(left / step) * step; x < left + box.width / view.scale; x += step) {
    const at = Math.round((x - left) * view.scale) + 0.5;
    pen.moveTo(at, 0);
    pen.lineTo(at, box.height);
  }
  for (let y = Math.ceil(low / step) * step; y < low + box.height / view.scale; y += step) {
    const at = Math.round(box.height - (y - low) * view.scale) + 0.5;
    pen.moveTo(0, at);
    pen.lineTo(box.width, at);
  }
  pen.stroke();
  pen.fillStyle = color.text;
  pen.font = "12px system-ui, sans-serif";
  pen.fillText(`${step} m`, 8, box.height - 8);
}

function trace(pen, points, color, width) {
  if (points.length < 2) return;
  pen.strokeStyle = color;
  pen.lineWidth = width;
  pen.beginPath();
  points.forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
  pen.stroke();
}

function dot(pen, x, y, radius) {
  pen.beginPath();
  pen.arc(x, y, radius, 0, 2 * Math.PI);
  pen.fill();
}

function outline(pen, marker, color, hair) {
  if (![LINE_STRIP, LINE_LIST].includes(marker.type)) return;
  const { r, g, b, a } = marker.color;
  pen.translate(marker.pose.position.x, marker.pose.position.y);
  pen.rotate(yaw(marker.pose.orientation));
  pen.strokeStyle = marker.ns === "footprint" ? color.body : a ? `rgba(${r * 255}, ${g * 255}, ${b * 255}, ${a})` : color.zone;
  pen.lineWidth = 1.5 * hair;
  pen.beginPath();
  marker.points.slice(0, MOST_POINTS).forEach(({ x, y }, i) => {
    if (i === 0 || (marker.type === LINE_LIST && i % 2 === 0)) pen.moveTo(x, y);
    else pen.lineTo(x, y);
  });
  pen.stroke();
}

function rays(pen, scan, color, hair) {
  pen.fillStyle = color.scan;
  const size = 3 * hair;
  pen.beginPath();
  const count = Math.min(scan.ranges.length, MOST_POINTS);
  for (let i = 0; i < count; i++) {
    const range = scan.ranges[i];
    if (!(range >= scan.range_min && range <= scan.range_max)) continue;
    const angle = scan.angle_min + i * scan.angle_increment;
    pen.rect(range * Math.cos(angle) - size / 2, range * Math.sin(angle) - size / 2, size, size);
  }
  pen.fill();
}

function body(pen, pose, color, hair) {
  pen.save();
  pen.translate(pose.x, pose.y);
  pen.rotate(pose.heading);
  const size = Math.max(0.2, 8 * hair);
  pen.fillStyle = color.body;
  pen.beginPath();
  pen.moveTo(size, 0);
  pen.lineTo(-size * 0.7, size * 0.7);
  pen.lineTo(-size * 0.35, 0);
  pen.lineTo(-size * 0.7, -size * 0.7);
  pen.closePath();
  pen.fill();
  pen.restore();
}
