// Where frames stand in the plane, as the map shows them.

/** The heading that a quaternion says, rad. */
export function yaw({ x, y, z, w }) {
  return Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z));
}

/** From a frame up to the one that stands in no other: where it stands in that, in the plane. */
export function chain(frame, things) {
  let at = { x: 0, y: 0, heading: 0 };
  let name = frame;
  for (let step = 0; step < 50; step++) {
    const found = things.frames[name];
    if (name === things.base && things.pose) {
      at = within(things.pose, at); // newer than its transform
      name = things.pose.frame;
    } else if (found) {
      const [x, y, z, w] = found.turned;
      at = within({ x: found.at[0], y: found.at[1], heading: yaw({ x, y, z, w }) }, at);
      name = found.parent;
    } else return { root: name, at };
  }
  return null; // frames that stand in one another
}

/** Where a frame stands in the one that the map shows; null where that is not known. */
export function placeOf(frame, things) {
  const home = chain(things.pose?.frame ?? "odom", things);
  const found = frame ? chain(frame, things) : home;
  return home !== null && found !== null && found.root === home.root ? found.at : null;
}

function within(outer, inner) {
  const [c, s] = [Math.cos(outer.heading), Math.sin(outer.heading)];
  return { x: outer.x + c * inner.x - s * inner.y, y: outer.y + s * inner.x + c * inner.y, heading: outer.heading + inner.heading };
}
