// What supervisors tell: nodes that start, fail, come back.

import { clock, el } from "../dom.js";
import { link } from "../link.js";
import { panel } from "../panel.js";
import { robot } from "../robot.js";

const MOST = 300;

/** The panel of events. */
export function events() {
  const list = el("ol", { class: "lines" });
  const scroll = el("div", { class: "scroll", tabindex: 0, role: "log", "aria-label": "Lines of events" }, list);
  let all = [];

  function show() {
    list.replaceChildren();
    add(all);
  }

  /** Those that are new at the end: a reader reads them, and no other ones again. */
  function add(some) {
    const atEnd = scroll.scrollTop + scroll.clientHeight >= scroll.scrollHeight - 20;
    list.append(...some.filter((one) => robot.has(one.robot, one.node)).map(row));
    while (list.childElementCount > MOST) list.firstChild.remove();
    if (atEnd) scroll.scrollTop = scroll.scrollHeight;
  }

  let first = true;
  link.on("welcome", () => { first = true; });
  link.on("events", (news) => {
    const isLate = first || news.events[0]?.time < all.at(-1)?.time; // of the past
    all = first ? news.events : [...all, ...news.events];
    all = all.sort((a, b) => a.time - b.time).slice(-MOST);
    first = false;
    if (isLate) show();
    else add(news.events);
  });
  robot.onChange(show);
  return panel("events", "Events", [], scroll);
}

function row(event) {
  const who = event.node || event.robot;
  return el(
    "li",
    { "data-level": event.alarm === "died" ? "error" : event.alarm ? "warn" : "" },
    el("time", {}, clock(event.time / 1e6)),
    el("b", {}, who.split("/").at(-1)),
    el("span", {}, event.reason ? `${event.event}: ${event.reason}` : event.event),
  );
}
