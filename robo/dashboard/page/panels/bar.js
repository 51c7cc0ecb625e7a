// The bar above all: which robot, how it does, whether it is heard; and the emergency stop, always in view.

import { age, el, number, say } from "../dom.js";
import { link } from "../link.js";
import { robot } from "../robot.js";

const STALE = 1500;
/** Without an answer for so long an emergency stop is said to be unconfirmed, ms. */
const UNSURE = 300;
/** Inputs of the reference robot's mux by which people drive. */
const MANUAL = ["joystick", "keyboard", "dashboard"];
/** Of what is said once a second. */
const STATES_STALE = 3500;

/** Fill the bar, and the alert below it. */
export function bar(place, lost) {
  const choice = el("select", { "aria-label": "Robot", onchange: () => robot.choose(choice.value) });
  const facts = el("dl", { class: "facts" });
  const fact = (name) => {
    const value = el("dd", {}, "–");
    facts.append(el("div", {}, el("dt", {}, name), value));
    return value;
  };
  const mode = fact("Mode");
  const speed = fact("Speed");
  const safety = fact("Safety");
  const driver = fact("Drives");
  const battery = fact("Battery");
  const nodes = fact("Nodes");
  const told = el("p", { class: "told", role: "status" });
  const stop = el("button", { id: "stop", type: "button", onclick: (event) => event.detail === 0 && press() }, "EMERGENCY STOP");
  // When it is pressed, not when it is let go; a click without a pointer is the keyboard's, or a reader's.
  stop.addEventListener("pointerdown", (event) => event.button === 0 && press());
  const reset = el("button", { id: "reset", type: "button", onclick: () => call("reset_emergency_stop") }, "Reset stop");
  const alarm = el("span");
  const since = el("span", { "aria-hidden": "true" }); // else a reader would say it all again at each second
  lost.append(alarm, since);
  place.append(choice, facts, told, el("div", { class: "stops" }, stop, reset));

  let unsure = ""; // of an emergency stop that has not been confirmed

  const seen = { odom: null, safety: null, mux: null, battery: null };

  function press() {
    if (stop.disabled) return;
    link.hear({ kind: "stand" });
    call("emergency_stop");
  }

  async function call(service) {
    const begin = performance.now();
    const name = robot.name;
    const stops = service === "emergency_stop";
    const late = setTimeout(() => { if (stops) unsure = `The stop of ${name} is not confirmed yet.`; }, UNSURE);
    try {
      const answer = await link.ask({ do: "call", service: robot.key(service), type: "std/Trigger" });
      say(told, `${answer.message || service.replaceAll("_", " ")} (${Math.round(performance.now() - begin)} ms)`);
      clearTimeout(late);
      if (stops) unsure = "";
    } catch (error) {
      say(told, `${service.replaceAll("_", " ")}: ${error.message}`);
      clearTimeout(late);
      if (stops) unsure = `Emergency stop of ${name}: ${error.message}.`;
    }
  }

  robot.onChange(() => {
    for (const name of Object.keys(seen)) seen[name] = null;
    unsure = "";
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

  setInterval(() => {
    const all = robot.name === null || robot.all.includes(robot.name) ? robot.all : [...robot.all, robot.name];
    if (choice.options.length !== all.length || [...choice.options].some((one, i) => one.value !== all[i])) {
      choice.replaceChildren(...all.map((name) => el("option", { value: name }, name || "(no name)")));
    }
    choice.value = robot.name ?? "";
    show(speed, seen.odom, STALE);
    show(safety, seen.safety, STATES_STALE);
    safety.dataset.level = seen.safety ? ["ok", "warn", "error", "stale"][seen.safety.level] ?? "" : "";
    const latched = Boolean(seen.safety?.latched);
    if (latched) unsure = "";
    stop.classList.toggle("latched", latched);
    say(stop, latched ? "STOPPED" : "EMERGENCY STOP");
    stop.setAttribute("aria-label", latched ? "Emergency stop: the robot is stopped" : "Emergency stop");
    reset.disabled = !link.drives || !seen.safety?.latched;
    stop.disabled = !link.drives;
    say(mode, latched ? "stopped" : seen.mux === null ? "–" : MANUAL.includes(seen.mux.driver) ? "manual" : seen.mux.driver ? "autonomous" : "idle");
    show(driver, seen.mux, STATES_STALE);
    show(battery, seen.battery, 10_000);
    battery.parentElement.hidden = seen.battery === null;
    const bad = robot.nodes.filter((node) => node.state !== "ready" || !["ok", null].includes(node.health));
    say(nodes, robot.nodes.length ? (bad.length ? `${bad.length} of ${robot.nodes.length} in trouble` : `${robot.nodes.length} well`) : "none");
    nodes.dataset.level = bad.length ? "warn" : "ok";
    const gone = link.isAlive
      ? robot.name !== null && robot.nodes.length === 0 ? `Nothing runs of ${robot.name}: what you see of it is old.` : ""
      : link.problem
        ? `The server lets nobody in with what this browser has: ${link.problem}.`
        : "No link to the server: what you see is old, and nothing can be driven.";
    lost.hidden = !gone && !unsure;
    say(alarm, [unsure, gone].filter(Boolean).join(" "));
    say(since, gone && !link.isAlive ? ` ${age(Math.min(link.silence + link.lag, performance.now()))}` : "");
    document.body.classList.toggle("lost", !link.isAlive);
  }, 100);
}

function show(place, fact, stale) {
  const old = fact ? link.now - fact.arrived : Infinity;
  place.classList.toggle("stale", old > stale);
  say(place, fact === null ? "–" : old > stale ? `${fact.text}, ${age(old)} ago` : fact.text);
}
