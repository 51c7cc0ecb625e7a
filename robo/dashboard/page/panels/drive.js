// Driving: by a joystick that stands when it is let go, by keys while they are held; one driver at a time.

import { el, number, say } from "../dom.js";
import { isPending } from "../emergency.js";
import { link } from "../link.js";
import { panel } from "../panel.js";
import { robot } from "../robot.js";

/** How often a command is said while a dead-man is held, ms. */
const PERIOD = 50;
/** By their places, so that they are there on each keyboard, whatever its letters are. */
const KEYS = {
  ArrowUp: [1, 0], KeyW: [1, 0], ArrowDown: [-1, 0], KeyS: [-1, 0],
  ArrowLeft: [0, 1], KeyA: [0, 1], ArrowRight: [0, -1], KeyD: [0, -1],
};
const MODIFIERS = ["Meta", "Control", "Alt", "OS"];

/** The panel for driving. */
export function drive() {
  const fast = slider("fast", "Speed", "m/s", 0.05, 1.0, 0.05, 0.3);
  const turn = slider("turn", "Turning", "rad/s", 0.1, 1.2, 0.1, 1.0); // a base that brakes with 3 rad/s² then stands within half a second
  const knob = el("div", { class: "knob" });
  const pad = el(
    "div",
    {
      id: "pad",
      tabindex: 0,
      role: "application",
      "aria-label": "Joystick: hold and drag; or focus it and hold the arrow keys or w, a, s, d. Let go to stand.",
    },
    knob,
  );
  // What a reader is told; and what changes too often for that.
  const told = el("span", { role: "status" });
  const moves = el("span");
  const words = el("p", { class: "told" }, told, moves);
  const made = panel("drive", "Drive", [], el("div", { class: "driving" }, pad, el("div", {}, fast.place, turn.place, words)));

  let wanted = null; // while a dead-man is held: parts of the full speed, forwards and to the left
  let grip = 0; // the number of the one that holds
  let isStopped = false; // whether an emergency stop holds, whoever has pressed it: as the robot has said last
  let pointer = null; // the one that holds the joystick
  const held = new Set(); // keys that are down

  /** Let go: the server has the robot stand, and says so to it several times. What is still down counts no more. */
  function stand() {
    held.clear();
    if (pointer !== null && pad.hasPointerCapture(pointer)) pad.releasePointerCapture(pointer);
    pointer = null;
    knob.style.transform = "";
    pad.classList.remove("held");
    if (wanted === null) return;
    wanted = null;
    link.send({ do: "release" });
  }

  /** Why nothing can be driven; empty where it can. */
  function lock() {
    if (!link.isAlive) return "no link: driving is locked";
    if (!link.drives) return "this page may look and not drive";
    if (!robot.isThere) return `${robot.absence}: driving is locked`;
    if (isPending(robot.name)) return "it is being stopped: driving is locked";
    if (isStopped) return "emergency stop: driving is locked until its reset";
    return "";
  }

  function want(forwards, left) {
    if (lock() || document.visibilityState !== "visible") return stand();
    if (wanted === null) grip = link.grip;
    wanted = [forwards, left];
    pad.classList.add("held");
    return undefined;
  }

  function tell() {
    if (wanted === null) return;
    if (lock()) {
      stand(); // it takes a new grip to drive on
      return;
    }
    const [forwards, left] = wanted;
    link.send({
      do: "drive",
      robot: robot.name ?? "",
      linear: forwards * fast.value,
      angular: left * turn.value,
      heard: link.beat,
      since: link.silence / 1000,
      grip,
    });
  }

  function drag(event) {
    const box = pad.getBoundingClientRect();
    const reach = box.width / 2;
    let x = (event.clientX - box.left - reach) / reach;
    let y = (event.clientY - box.top - reach) / reach;
    const far = Math.hypot(x, y);
    if (far > 1) [x, y] = [x / far, y / far];
    knob.style.transform = `translate(${x * reach * 0.7}px, ${y * reach * 0.7}px)`;
    const quiet = (part) => (Math.abs(part) < 0.1 ? 0 : part);
    want(quiet(-y), quiet(-x));
  }

  pad.addEventListener("pointerdown", (event) => {
    event.preventDefault();
    if (event.button !== 0 || pointer !== null) return;
    pad.setPointerCapture(event.pointerId);
    pointer = event.pointerId;
    pad.focus();
    drag(event);
  });
  pad.addEventListener("pointermove", (event) => {
    if (event.pointerId === pointer) drag(event);
  });
  for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
    pad.addEventListener(end, (event) => event.pointerId === pointer && stand());
  }
  pad.addEventListener("blur", stand);
  pad.addEventListener("contextmenu", (event) => event.preventDefault());

  pad.addEventListener("keydown", (event) => {
    // Of a key that is let go while Cmd is down macOS says nothing.
    if (event.ctrlKey || event.metaKey || event.altKey || MODIFIERS.includes(event.key)) {
      if (held.size) stand();
      return;
    }
    if (!(event.code in KEYS)) return;
    event.preventDefault();
    if (event.repeat || pointer !== null) return; // one that was down when the robot was made to stand
    held.add(event.code);
    follow();
  });
  // Wherever the key is let go, and with whatever else.
  window.addEventListener("keyup", (event) => {
    if (MODIFIERS.includes(event.key) && held.size) stand();
    if (!held.delete(event.code)) return;
    if (held.size) follow();
    else stand();
  });

  function follow() {
    const parts = [...held].map((key) => KEYS[key]);
    const sum = (index) => Math.max(-1, Math.min(1, parts.reduce((all, part) => all + part[index], 0)));
    want(sum(0), sum(1));
    knob.style.transform = `translate(${-sum(1) * 40}%, ${-sum(0) * 40}%)`;
  }

  // Whatever takes the page out of sight or hand: the robot stands.
  window.addEventListener("blur", stand);
  window.addEventListener("pagehide", stand);
  document.addEventListener("visibilitychange", () => document.visibilityState === "hidden" && stand());
  robot.onChange(() => {
    stand();
    isStopped = false;
  });
  robot.watch("safety_state", ["diagnostic/DiagnosticStatus"], (message) => {
    isStopped = message.values.some(({ key, value }) => key === "reason" && value === "emergency_stop");
    if (isStopped) stand();
  });
  setInterval(tell, PERIOD);

  let refusal = "";
  let refusedAt = -Infinity;
  link.on("refused", ({ reason, late }) => {
    refusal = reason;
    refusedAt = performance.now();
    if (!late) stand(); // it takes a new grip; a command that came late does not, the next one is newer
  });
  let drivers = {};
  link.on("drivers", (news) => {
    drivers = news.drivers;
    if (wanted !== null && grip < (news.ended[robot.name ?? ""] ?? 0)) stand();
  });
  setInterval(() => {
    const who = drivers[robot.name ?? ""];
    const mine = who === link.name;
    const locked = lock();
    pad.classList.toggle("locked", Boolean(locked) || (who !== undefined && !mine));
    pad.setAttribute("aria-disabled", String(Boolean(locked)));
    say(moves, !locked && mine && wanted ? `${number(wanted[0] * fast.value)} m/s, ${number(wanted[1] * turn.value)} rad/s` : "");
    if (locked) say(told, locked);
    else if (performance.now() - refusedAt < 2000) say(told, `refused: ${refusal}`);
    else if (mine) say(told, wanted ? "" : "stands");
    else say(told, who === undefined ? "hold the joystick, or its keys, to drive" : `${who} drives`);
  }, 100);
  return made;
}

function slider(id, name, unit, min, max, step, value) {
  const shown = el("output", { for: id }, `${value} ${unit}`);
  const input = el("input", {
    id, type: "range", min, max, step, value,
    oninput: () => say(shown, `${input.value} ${unit}`),
  });
  return {
    place: el("label", { class: "slider" }, name, input, shown),
    get value() {
      return Number(input.value);
    },
  };
}
