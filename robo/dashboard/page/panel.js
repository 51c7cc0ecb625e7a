// What panels have in common: a heading, a note on how old it is, what stands in it.

import { age, el, say } from "./dom.js";
import { link } from "./link.js";

const clocks = [];

/** A panel. `id` is for its address and style, `tools` stand beside its heading. */
export function panel(id, title, tools, ...children) {
  return el(
    "section",
    { id, class: "panel", "aria-labelledby": `${id}-title` },
    el("div", { class: "head" }, el("h2", { id: `${id}-title` }, title), ...tools),
    ...children,
  );
}

/**
 * A place that says how old something is. `when()` returns its time, ms by `link.now`; null where there is none, of
 * which `nothing()` says what there is to say.
 */
export function ageOf(when, stale = 1000, nothing = () => "nothing yet") {
  const place = el("span", { class: "age" });
  clocks.push(() => {
    const at = when();
    const old = at === null ? null : Math.max(0, link.now - at);
    say(place, old === null ? nothing() : `${age(old)} old`);
    place.classList.toggle("stale", old !== null && old > stale);
  });
  return place;
}

setInterval(() => clocks.forEach((tell) => tell()), 250);
