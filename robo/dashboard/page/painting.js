// Drawing the map: metres, x to the right.

import { placeOf } from "./plane.js";

/** Kinds of markers, by ROS's numbers, that are drawn. */
const LINE_STRIP = 4;
const LINE_LIST = 5;
/** An older scan is drawn in the colour of what is old, ms. */
export const STALE = 1000;

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
  try {
    paintIt();
  } finally {
    pen.restore();
  }
}

/** Draw it all. `now` is the time by `link.now`. */
export function paint(canvas, view, things, following, now) {
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
  for (const zone of things.zones.values()) inFrame(pen, zone.frame, things, () => outline(pen, zone, color, hair));
  if (things.scan) {
    const shade = now - things.arrived.scan > STALE ? color.stale : color.scan;
    inFrame(pen, things.scan.frame, things, () => rays(pen, things.scan, shade, hair));
  }
  if (robotAt) body(pen, robotAt, color, hair);
}

function floor(pen, { picture, width, height, at }) {
  pen.translate(at.x, at.y);
  pen.rotate(at.heading);
  pen.scale(1, -1);
  pen.imageSmoothingEnabled = false;
  pen.drawImage(picture, 0, -height, width, height);
}

function colors(canvas) {
  const style = getComputedStyle(canvas);
  const of = (name) => style.getPropertyValue(`--${name}`).trim();
  return Object.fromEntries(["grid", "text", "trail", "path", "scan", "body", "zone", "stale"].map((name) => [name, of(name)]));
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

function outline(pen, { type, ns, at, points, color: own }, color, hair) {
  if (![LINE_STRIP, LINE_LIST].includes(type)) return;
  pen.translate(at.x, at.y);
  pen.rotate(at.heading);
  pen.strokeStyle = ns === "footprint" ? color.body : own ? own : color.zone;
  pen.lineWidth = 1.5 * hair;
  pen.beginPath();
  points.forEach(([x, y], i) => {
    if (i === 0 || (type === LINE_LIST && i % 2 === 0)) pen.moveTo(x, y);
    else pen.lineTo(x, y);
  });
  pen.stroke();
}

function rays(pen, { points }, color, hair) {
  pen.fillStyle = color;
  const size = 3 * hair;
  pen.beginPath();
  for (const [x, y] of points) pen.rect(x - size / 2, y - size / 2, size, size);
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
