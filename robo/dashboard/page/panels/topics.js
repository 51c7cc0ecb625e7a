// The topics: who says what how often; of the one that is chosen its last message, its age and what got lost of it.

import { Rows, el, number, plain, say } from "../dom.js";
import { shown } from "../fields.js";
import { link } from "../link.js";
import { ageOf, panel } from "../panel.js";
import { robot } from "../robot.js";

const MOST = 200;

/** The panel of topics. */
export function topics() {
  const body = el("tbody");
  const head = ["Topic", "Type", "Rate", "Lost", "Ends"].map((name) => el("th", { scope: "col" }, name));
  const text = el("pre", { class: "scroll message", tabindex: 0, role: "region", "aria-label": "Last message" });
  const title = el("h3", {}, "choose a topic");
  const search = el("input", { type: "search", placeholder: "search", "aria-label": "Search topics", oninput: () => list() });
  const left = el("span", { class: "age" });
  let chosen = null;
  let at = null;
  let end = () => {};
  const made = panel(
    "topics", "Topics", [left, ageOf(() => robot.pictureAt, 3500), search],
    el("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": "All topics" }, el("table", {}, el("thead", {}, el("tr", {}, ...head)), body)),
    el("div", { class: "head" }, title, ageOf(() => at, 1000, () => (chosen ? "nothing yet" : ""))),
    text,
  );
  const rows = new Rows(body, (topic) => topic.key, make, fill);

  function make(topic) {
    const cells = Array.from({ length: 5 }, () => el("td"));
    const open = el("button", { type: "button", class: "link", onclick: () => choose(topic.key) }, short(topic.key));
    cells[0].append(open);
    return Object.assign(el("tr", {}, ...cells), { cells_: cells });
  }

  function fill(row, topic) {
    say(row.cells_[1], topic.type);
    say(row.cells_[2], topic.rate === null ? "–" : `${number(topic.rate, 1)} Hz`);
    say(row.cells_[3], String(topic.dropped));
    say(row.cells_[4], `${topic.publishers.length} → ${topic.subscribers.length}`);
    row.cells_[4].title = plain(`${topic.publishers.join(", ") || "nobody"} → ${topic.subscribers.join(", ") || "nobody"}`);
    row.classList.toggle("chosen", topic.key === chosen);
  }

  function choose(key) {
    end();
    chosen = key;
    at = null;
    say(title, short(key));
    say(text, "");
    let due = 0;
    end = link.watch(key, undefined, (message, { arrived, type, size }) => {
      at = arrived;
      if (performance.now() < due) return;
      due = performance.now() + 200; // nobody reads faster
      say(text, message === undefined ? unread(size, type) : shown(message, type).trimStart());
    });
    list();
  }

  function list() {
    const words = search.value.toLowerCase();
    const wanted = robot.topics.filter((one) => `${one.key} ${one.type}`.toLowerCase().includes(words));
    rows.show(wanted.slice(0, MOST));
    say(left, wanted.length > MOST ? `${wanted.length - MOST} more: search for one` : "");
  }

  link.on("picture", list);
  robot.onChange(() => {
    end();
    chosen = at = null;
    say(title, "choose a topic");
    say(text, "");
    list();
  });
  return made;
}

function unread(size, type) {
  return size ? `${size} bytes of ${type || "an unknown type"} that cannot be read` : "a message of more than 8 MB, which is not shown";
}

function short(key) {
  return robot.name && key.startsWith(`${robot.name}/`) ? key.slice(robot.name.length + 1) : key;
}
