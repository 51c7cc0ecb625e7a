// What the map shows, made of messages: of what strangers send only what can be drawn. What cannot raises.

import { yaw } from "./plane.js";

const DELETE = 2;
const DELETEALL = 3;
/** No more than can be drawn. */
export const MOST_POINTS = 20_000;
const MOST_MARKERS = 500;
const MOST_CELLS = 2 ** 24;

/** Nothing yet. `arrived` has when what is drawn has come, ms by `link.now`. */
export function empty() {
  return { pose: null, base: "base_link", trail: [], scan: null, grid: null, paths: {}, unplaced: new Set(), zones: new Map(), frames: {}, arrived: {} };
}

/** A pose in the plane; null where it is none. */
export function poseOf({ position, orientation }) {
  const pose = { x: position.x, y: position.y, heading: yaw(orientation) };
  return Number.isFinite(pose.x + pose.y + pose.heading) ? pose : null;
}

/** A scan as points in its frame, m. */
export function scanOf({ header, ranges, range_min, range_max, angle_min, angle_increment }) {
  const points = [];
  const count = Math.min(ranges.length, MOST_POINTS);
  for (let i = 0; i < count; i++) {
    const range = ranges[i];
    if (!(range >= range_min && range <= range_max)) continue;
    const angle = angle_min + i * angle_increment;
    points.push([range * Math.cos(angle), range * Math.sin(angle)]);
  }
  return { frame: String(header.frame_id), points };
}

/** A path as points. */
export function pathOf({ header, poses }) {
  const points = poses.slice(0, MOST_POINTS).map(({ pose }) => [pose.position.x, pose.position.y]);
  return { frame: String(header.frame_id), points: points.filter(([x, y]) => Number.isFinite(x + y)) };
}

/** The markers that are there after some more have come; without those that cannot be drawn. */
export function marked(before, markers) {
  const all = new Map(before);
  for (const marker of markers) {
    const name = `${marker.ns}\n${marker.id}`;
    if (marker.action === DELETEALL) {
      for (const [other, one] of all) if (!marker.ns || one.ns === marker.ns) all.delete(other);
    } else if (marker.action === DELETE) all.delete(name);
    else if (all.size < MOST_MARKERS || all.has(name)) {
      const made = markerOf(marker);
      if (made) all.set(name, made);
    }
  }
  return all;
}

function markerOf({ header, ns, type, pose, points, color }) {
  const at = header && pose?.position && pose.orientation ? poseOf(pose) : null;
  if (at === null || !Array.isArray(points)) return null;
  const outline = points.slice(0, MOST_POINTS).map((point) => [point?.x, point?.y]);
  const { r, g, b, a } = color ?? {};
  return {
    frame: String(header.frame_id), ns, type, at,
    points: outline.filter(([x, y]) => Number.isFinite(x + y)),
    color: a ? `rgba(${r * 255}, ${g * 255}, ${b * 255}, ${a})` : "",
  };
}

/** An occupancy grid as a picture: free cells light, occupied ones dark, unknown ones hardly seen. */
export function gridOf(message) {
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
  const at = poseOf(origin);
  return at && { picture, width: width * resolution, height: height * resolution, at, frame: String(message.header.frame_id) };
}

