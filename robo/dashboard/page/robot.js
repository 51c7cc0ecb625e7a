// Which robot the page shows, and names of its topics.

import { link } from "./link.js";

const changed = [];
/** For so long a look at what runs is believed, and odometry where the robot has told of it, ms. */
const LOOK = 5000;
const ODOMETRY = 1500;

export const robot = {
  name: null,
  all: [],
  picture: { robots: [], nodes: [], topics: [] },
  /** When it was told, ms by this machine's clock; null before. */
  toldAt: null,
  /** The same, ms by `link.now`, of which more is known with each beat. */
  get pictureAt() {
    return this.toldAt === null ? null : this.toldAt + link.offset;
  },
  /** When its odometry came last; null where it has none. */
  odometryAt: null,

  key(topic) {
    return this.name ? `${this.name}/${topic}` : topic;
  },

  /** Its nodes. */
  get nodes() {
    return this.picture.nodes.filter((node) => isWithin(node.node, this.name));
  },

  /** Whether something of a run, or of a node of it, is of this robot, or of the run that it is part of. */
  has(run, node) {
    if (node && node.includes("/")) return isWithin(node, this.name ?? "");
    return run === this.name || isWithin(run, this.name ?? "") || isWithin(this.name ?? "", run);
  },

  get topics() {
    return this.picture.topics.filter((topic) => isWithin(topic.key, this.name));
  },

  /** Why it cannot be driven, in words: nothing runs of it, or it is not heard. Empty where it is there. */
  get absence() {
    if (this.name === null || this.pictureAt === null) return "no robot is seen yet";
    const who = this.name || "the robot";
    if (link.now - this.pictureAt > LOOK) return `${who} is not heard`;
    if (this.nodes.length === 0) return `nothing runs of ${who}`;
    return this.odometryAt !== null && link.now - this.odometryAt > ODOMETRY ? `${who} does not say how it moves` : "";
  },

  get isThere() {
    return this.absence === "";
  },

  choose(name) {
    if (name === this.name) return;
    this.name = name;
    this.odometryAt = null;
    history.replaceState(null, "", name ? `#${encodeURIComponent(name)}` : "#");
    for (const listener of changed) listener(name);
  },

  /** Have a function called now where there is a robot, and whenever it is another one. */
  onChange(listener) {
    changed.push(listener);
    if (this.name !== null) listener(this.name);
  },

  /** Watch a topic of whichever robot is shown. */
  watch(topic, types, listener) {
    let end = () => {};
    this.onChange(() => {
      end();
      end = link.watch(this.key(topic), types, listener);
    });
  },
};

robot.watch("odom", ["nav/Odometry"], (message, { arrived }) => { robot.odometryAt = arrived; });

function isWithin(name, namespace) {
  return !namespace || name.replace(/^\//, "").startsWith(`${namespace}/`);
}

link.on("picture", ({ picture }) => {
  robot.picture = picture;
  robot.toldAt = performance.now();
  robot.all = picture.robots;
  if (robot.name === null && robot.all.length) robot.choose(robot.all[0]);
});
window.addEventListener("hashchange", () => wanted() && robot.choose(wanted()));

/** How a node does: ok, warn, error or stale; empty where it does not run, and is not meant to. */
export function levelOf({ state, health }) {
  if (state === "ready" || state === "completed") return health ?? "ok";
  if (state === "standby" || state === "stopped") return "";
  return state === "failed" ? "error" : "warn";
}

/** The robot that the page's address names; empty where it names none. */
function wanted() {
  try {
    return decodeURIComponent(location.hash.slice(1));
  } catch (error) {
    return "";
  }
}

// One that the address names is there at once, whatever is seen: its stop can be pressed, and no other one is driven by
// mistake meanwhile.
if (wanted()) robot.choose(wanted());
