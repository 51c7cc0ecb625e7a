// The map: where the robot is and was, what it sees and plans, what its safety watches. Metres, x to the right.

import { el, number, say } from "../dom.js";
import { link } from "../link.js";
import { ageOf, panel } from "../panel.js";
import { robot } from "../robot.js";

const TRAIL = 4000;
const STEP = 0.05;
/** Kinds of markers, by ROS's numbers, that are drawn. */
const LINE_STRIP = 4;
const LINE_LIST = 5;

/** The panel of the map. */
export function map() {
  const canvas = el("canvas", { tabindex: 0, role: "img", "aria-label": "Map of the robot and what it sees" });
  const where = el("p", { class: "told", role: "status" });
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
    where,
  );

  const view = { scale: 40, x: 0, y: 0 };
  let things = empty();
  let dirty = false;

  function draw() {
    if (dirty) return;
    dirty = true;
    requestAnimationFrame(() => {
      dirty = false;
      paint(canvas, view, things, follow.checked);
      canvas.dataset.drawn = String(Number(canvas.dataset.drawn ?? 0) + 1);
    });
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
  robot.watch("odom", (message, { arrived }) => {
    const { position, orientation } = message.pose.pose;
    things.pose = { x: position.x, y: position.y, heading: yaw(orientation), frame: message.header.frame_id };
    things.base = message.child_frame_id;
    const last = things.trail.at(-1);
    if (!last || Math.hypot(last[0] - position.x, last[1] - position.y) > STEP) {
      things.trail.push([position.x, position.y]);
      if (things.trail.length > TRAIL) things.trail.shift();
    }
    seen.at = arrived;
    say(where, `x ${number(position.x)} m, y ${number(position.y)} m, heading ${number((things.pose.heading * 180) / Math.PI, 0)}°`);
    draw();
  });
  robot.watch("scan", (message) => {
    things.scan = message;
    draw();
  });
  robot.watch("map", (message) => {
    things.grid = grid(message);
    draw();
  });
  for (const topic of ["path", "plan", "waypoints"]) {
    robot.watch(topic, (message) => {
      things.paths[topic] = message;
      draw();
    });
  }
  robot.watch("safety_zones", (message) => {
    things.zones = message.markers;
    draw();
  });
  robot.watch("tf", () => {});
  robot.watch("tf_static", () => {});
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
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);

  async function send(event) {
    const box = canvas.getBoundingClientRect();
    const x = view.x + (event.clientX - box.left - box.width / 2) / view.scale;
    const y = view.y - (event.clientY - box.top - box.height / 2) / view.scale;
    const pose = { header: { frame_id: things.pose?.frame ?? "odom" }, pose: { position: { x, y, z: 0 } } };
    try {
      await link.ask({
        do: "publish",
        topic: robot.key("waypoints"),
        type: "nav/Path",
        message: { header: pose.header, poses: [pose] },
      });
      say(where, `waypoint x ${number(x)} m, y ${number(y)} m is said`);
    } catch (error) {
      say(where, `no waypoint: ${error.message}`);
    }
  }
  return made;
}

function button(sign, name, onclick) {
  return el("button", { type: "button", "aria-label": name, title: name, onclick }, sign);
}

function empty() {
  return { pose: null, base: "base_link", trail: [], scan: null, grid: null, paths: {}, zones: [], frames: {} };
}

function yaw({ x, y, z, w }) {
  return Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z));
}

/** Where a frame stands in the one in which the robot is shown, by transforms in the plane. */
function placeOf(frame, things) {
  let at = { x: 0, y: 0, heading: 0 };
  const home = things.pose?.frame ?? "odom";
  for (let step = 0, name = frame; name !== home; step++) {
    if (name === things.base && things.pose) return within(things.pose, at);
    const found = things.frames[name];
    if (!found || step > 50) return null;
    const [x, y, z, w] = found.turned;
    at = within({ x: found.at[0], y: found.at[1], heading: yaw({ x, y, z, w }) }, at);
    name = found.parent;
  }
  return at;
}

function within(outer, inner) {
  const [c, s] = [Math.cos(outer.heading), Math.sin(outer.heading)];
  return { x: outer.x + c * inner.x - s * inner.y, y: outer.y + s * inner.x + c * inner.y, heading: outer.heading + inner.heading };
}

/** An occupancy grid as a picture. */
function grid(message) {
  const { width, height, resolution, origin } = message.info;
  if (!width || !height) return null;
  const picture = new OffscreenCanvas(width, height);
  const pen = picture.getContext("2d");
  const image = pen.createImageData(width, height);
  for (let i = 0; i < width * height; i++) {
    const cell = (message.data[i] << 24) >> 24;
    // Row 0 is the lowest.
    const to = ((height - 1 - Math.floor(i / width)) * width + (i % width)) * 4;
    const shade = cell < 0 ? 128 : 255 - cell * 2.55;
    image.data.set([shade, shade, shade, cell < 0 ? 60 : 255], to);
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
  if (following && things.pose) [view.x, view.y] = [things.pose.x, things.pose.y];
  const color = colors(canvas);
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, box.width, box.height);
  lines(pen, view, box, color);
  // From here on in metres, y upwards.
  pen.setTransform(ratio * view.scale, 0, 0, -ratio * view.scale,
    ratio * (box.width / 2 - view.x * view.scale), ratio * (box.height / 2 + view.y * view.scale));
  const hair = 1 / view.scale;
  if (things.grid) {
    const { picture, width, height, origin } = things.grid;
    pen.save();
    pen.translate(origin.position.x, origin.position.y);
    pen.rotate(yaw(origin.orientation));
    pen.scale(1, -1);
    pen.imageSmoothingEnabled = false;
    pen.drawImage(picture, 0, -height, width, height);
    pen.restore();
  }
  for (const path of Object.values(things.paths)) {
    const points = path.poses.map(({ pose }) => [pose.position.x, pose.position.y]);
    trace(pen, points, color.path, 1.5 * hair);
    pen.fillStyle = color.path;
    for (const [x, y] of points.length <= 100 ? points : []) dot(pen, x, y, 3 * hair);
  }
  trace(pen, things.trail, color.trail, 2 * hair);
  for (const zone of things.zones) outline(pen, zone, things, color, hair);
  if (things.scan) rays(pen, things, color, hair);
  if (things.pose) body(pen, things.pose, color, hair);
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

function outline(pen, marker, things, color, hair) {
  if (marker.action !== 0 || ![LINE_STRIP, LINE_LIST].includes(marker.type)) return;
  const at = placeOf(marker.header.frame_id, things);
  if (at === null) return;
  const { r, g, b, a } = marker.color;
  pen.save();
  pen.translate(at.x, at.y);
  pen.rotate(at.heading);
  pen.translate(marker.pose.position.x, marker.pose.position.y);
  pen.rotate(yaw(marker.pose.orientation));
  pen.strokeStyle = a ? `rgba(${r * 255}, ${g * 255}, ${b * 255}, ${a})` : color.zone;
  pen.lineWidth = 1.5 * hair;
  pen.beginPath();
  marker.points.forEach(({ x, y }, i) => {
    if (i === 0 || (marker.type === LINE_LIST && i % 2 === 0)) pen.moveTo(x, y);
    else pen.lineTo(x, y);
  });
  pen.stroke();
  pen.restore();
}

function rays(pen, things, color, hair) {
  const { scan } = things;
  const at = placeOf(scan.header.frame_id, things);
  if (at === null) return;
  pen.save();
  pen.translate(at.x, at.y);
  pen.rotate(at.heading);
  pen.fillStyle = color.scan;
  const size = 3 * hair;
  scan.ranges.forEach((range, i) => {
    if (!(range >= scan.range_min && range <= scan.range_max)) return;
    const angle = scan.angle_min + i * scan.angle_increment;
    pen.fillRect(range * Math.cos(angle) - size / 2, range * Math.sin(angle) - size / 2, size, size);
  });
  pen.restore();
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
