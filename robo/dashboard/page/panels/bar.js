// The bar above all: which robot, how it does, whether it is heard; and the emergency stop, always in view.

import { age, el, number, say } from "../dom.js";
import { isPending, stopRobot, unconfirmed, withdraw } from "../emergency.js";
import { link } from "../link.js";
import { levelOf, robot } from "../robot.js";

const STALE = 1500;
/** Inputs of the reference robot's mux by which people drive. */
const MANUAL = ["joystick", "keyboard", "dashboard"];
/** Of what is said once a second. */
const STATES_STALE = 3500;
/** What has come of a button is shown for so long, ms. */
const SHOWN = 15_000;
/** So long it may take until a robot is seen, ms. */
const FIRST = 3000;

/** Fill the bar, and the alert below it. */
export function bar(place, lost) {
  const choice = el("select", { "aria-label": "Robot", onchange: () => robot.choose(choice.value) });
  const facts = el("dl", { class: "facts" });
  const fact = (name) => {
    const value = el("dd", {}, "–");
    facts.append(el("div", { class: name.toLowerCase() }, el("dt", {}, name), value));
    return value;
  };
  const mode = fact("Mode");
  const speed = fact("Speed");
  const safety = fact("Safety");
  const driver = fact("Drives");
  const battery = fact("Battery");
  const nodes = fact("Nodes");
  const told = el("p", { class: "told", role: "status" });
  let toldAt = -Infinity;
  const report = (words) => {
    toldAt = performance.now();
    say(told, words);
  };
  // When it is pressed, not when it is let go; a click that no pointer began is the keyboard's, or a reader's.
  let pressedAt = -Infinity;
  const stop = el("button", { id: "stop", type: "button", onclick: () => performance.now() - pressedAt > 1000 && press() }, "EMERGENCY STOP");
  stop.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    pressedAt = performance.now();
    press();
  });
  const reset = el("button", { id: "reset", type: "button", onclick: () => (withdrawn() ? report("the stop is asked for no more") : call("reset_emergency_stop")) }, "Reset stop");
  const alarm = el("span");
  const since = el("span", { "aria-hidden": "true" }); // else a reader would say it all again at each second
  lost.append(alarm, since);
  place.append(choice, facts, told, el("div", { class: "stops" }, stop, reset));

  const seen = { odom: null, safety: null, mux: null, battery: null };

  let isWanted = false; // a stop that was pressed while no robot was seen: of the first one that is

  async function press() {
    if (stop.disabled) return;
    isWanted = robot.name === null;
    if (isWanted) {
      tell();
      return;
    }
    const begun = stopRobot(robot.name, robot.key("emergency_stop"));
    tell();
    const answer = await begun;
    if (answer) report(`${answer.message || "emergency stop"} (${Math.round(answer.took)} ms)`);
  }

  function withdrawn() {
    const was = isWanted;
    isWanted = false;
    return withdraw(robot.name) || was;
  }

  async function call(service) {
    const begin = performance.now();
    try {
      const answer = await link.ask({ do: "call", service: robot.key(service), type: "std/Trigger" });
      report(`${answer.message || service.replaceAll("_", " ")} (${Math.round(performance.now() - begin)} ms)`);
    } catch (error) {
      report(`${service.replaceAll("_", " ")}: ${error.message}`);
    }
  }

  robot.onChange(() => {
    for (const name of Object.keys(seen)) seen[name] = null;
    if (isWanted) press();
  });
  robot.watch("odom", ["nav/Odometry"], (message, { arrived }) => {
    const { linear, angular } = message.twist.twist;
    seen.odom = { arrived, text: `${number(linear.x)} m/s, ${number(angular.z)} rad/s` };
  });
  robot.watch("safety_state", ["diagnostic/DiagnosticStatus"], (message, { arrived }) => {
    const said = Object.fromEntries(message.values.map(({ key, value }) => [key, value]));
    seen.safety = { arrived, level: message.level, latched: said.reason === "emergency_stop", text: message.message };
  });
  robot.watch("mux_state", ["diagnostic/DiagnosticStatus"], (message, { arrived }) => {
    const said = Object.fromEntries(message.values.map(({ key, value }) => [key, value]));
    seen.mux = { arrived, driver: said.driver, text: said.reason === "locked" ? `nobody: ${message.message}` : said.driver || "nobody" };
  });
  robot.watch("battery", ["sensor/BatteryState"], (message, { arrived }) => {
    const share = Number.isFinite(message.percentage) ? ` ${Math.round(message.percentage * 100)} %` : "";
    seen.battery = { arrived, text: `${number(message.voltage, 1)} V${share}` };
  });

  function choices() {
    const all = robot.name === null || robot.all.includes(robot.name) ? robot.all : [...robot.all, robot.name];
    if (choice.options.length !== all.length || [...choice.options].some((one, i) => one.value !== all[i])) {
      choice.replaceChildren(...all.map((name) => el("option", { value: name }, name || "(no name)")));
    }
    choice.value = robot.name ?? "";
  }

  /** What is not as it should be, in words. */
  function trouble() {
    if (link.isAlive) {
      if (robot.toldAt === null || robot.name === null) return performance.now() > FIRST ? "No robot is seen yet: is one started, on this network?" : "";
      return robot.isThere ? "" : `${upper(robot.absence)}: what you see of it is old, and it cannot be driven.`;
    }
    return link.problem
      ? `The server lets nobody in with what this browser has: ${link.problem}.`
      : "No link to the server: what you see is old, and nothing can be driven.";
  }

  function alarms() {
    const gone = trouble();
    const early = isWanted ? "EMERGENCY STOP NOT SENT: no robot is seen yet. It is sent as soon as one is." : "";
    const words = [early, unconfirmed(), gone].filter(Boolean).join(" ");
    lost.hidden = !words;
    say(alarm, words);
    say(since, gone && !link.isAlive ? ` ${age(Math.min(link.silence + link.lag, performance.now()))}` : "");
    document.body.classList.toggle("lost", !link.isAlive || !robot.isThere);
  }

  /** Whether it is stopped holds until it says otherwise: where simulated time stands it says nothing more. */
  const isLatched = () => Boolean(seen.safety?.latched);

  function buttons() {
    const [latched, pending] = [isLatched(), isWanted || isPending(robot.name)];
    stop.classList.toggle("latched", latched);
    stop.classList.toggle("pending", pending && !latched);
    const old = latched && link.now - seen.safety.arrived > STATES_STALE;
    const stopped = old ? `STOPPED (said ${age(link.now - seen.safety.arrived)} ago)` : "STOPPED";
    say(stop, latched ? stopped : pending ? "STOPPING …" : "EMERGENCY STOP");
    stop.setAttribute("aria-label", latched ? `Emergency stop: the robot ${old ? "was stopped when it was last heard" : "is stopped"}` : pending ? "Emergency stop: not confirmed yet" : "Emergency stop");
    stop.disabled = !link.drives;
    say(reset, pending ? "Withdraw stop" : "Reset stop");
    reset.disabled = !link.drives || !(latched || pending);
  }

  function values() {
    show(speed, seen.odom, STALE);
    show(safety, seen.safety, STATES_STALE);
    safety.dataset.level = seen.safety ? ["ok", "warn", "error", "stale"][seen.safety.level] ?? "" : "";
    show(mode, modeOf(seen.mux, isLatched() ? seen.safety : null), STATES_STALE);
    show(driver, seen.mux, STATES_STALE);
    show(battery, seen.battery, 10_000);
    battery.parentElement.hidden = seen.battery === null;
    const bad = robot.nodes.filter((node) => !["ok", ""].includes(levelOf(node)));
    const text = robot.nodes.length ? (bad.length ? `${bad.length} of ${robot.nodes.length} in trouble` : `${robot.nodes.length} well`) : "none";
    show(nodes, robot.pictureAt === null ? null : { arrived: robot.pictureAt, text }, STATES_STALE);
    nodes.dataset.level = bad.length ? "warn" : "ok";
  }

  /** The alarm and the buttons first; and what cannot be shown, since somebody has sent nonsense, holds up nothing else. */
  function tell() {
    for (const part of [alarms, buttons, choices, values]) link.guarded(part);
    if (performance.now() - toldAt > SHOWN) say(told, "");
  }
  setInterval(tell, 100);
}

function modeOf(mux, stopped) {
  if (stopped) return { arrived: stopped.arrived, text: "stopped" };
  if (mux === null) return null;
  return { arrived: mux.arrived, text: MANUAL.includes(mux.driver) ? "manual" : mux.driver ? "autonomous" : "idle" };
}

const upper = (words) => words.charAt(0).toUpperCase() + words.slice(1);

/** A value; one that is old with its age, which comes first, since the end may be cut. */
function show(place, fact, stale) {
  const old = fact ? link.now - fact.arrived : 0;
  place.classList.toggle("stale", old > stale);
  say(place, fact === null ? "–" : old > stale ? `${age(old)} ago: ${fact.text}` : fact.text);
}
