// Which robot the page shows, and names of its topics.

import { link } from "./link.js";

const changed = [];

export const robot = {
  name: null,
  all: [],
  picture: { robots: [], nodes: [], topics: [] },
  pictureAt: -Infinity,

  key(topic) {
    return this.name ? `${this.name}/${topic}` : topic;
  },

  /** Its nodes. */
  get nodes() {
    return this.picture.nodes.filter((node) => isWithin(node.node, this.name));
  },

  get topics() {
    return this.picture.topics.filter((topic) => isWithin(topic.key, this.name));
  },

  choose(name) {
    if (name === this.name) return;
    this.name = name;
    location.hash = name ? encodeURIComponent(name) : "";
    for (const listener of changed) listener(name);
  },

  /** Have a function called now where there is a robot, and whenever it is another one. */
  onChange(listener) {
    changed.push(listener);
    if (this.name !== null) listener(this.name);
  },

  /** Watch a topic of whichever robot is shown. */
  watch(topic, listener) {
    let end = () => {};
    this.onChange(() => {
      end();
      end = link.watch(this.key(topic), listener);
    });
  },
};

function isWithin(name, namespace) {
  return !namespace || name.replace(/^\//, "").startsWith(`${namespace}/`);
}

link.on("picture", ({ picture }) => {
  robot.picture = picture;
  robot.pictureAt = performance.now();
  robot.all = picture.robots;
  const asked = decodeURIComponent(location.hash.slice(1));
  if (robot.name === null && robot.all.length) robot.choose(robot.all.includes(asked) ? asked : robot.all[0]);
});
