// The emergency stop: a wish that stays until the robot has confirmed it, or somebody has withdrawn it.

import { link } from "./link.js";

/** So often it is asked again, ms, and so many answers are waited for at once. */
const AGAIN = 500;
const MOST = 3;
/** After so long without an answer it is said that there is none, ms. */
const SOON = 1000;

/** By robots that are to stop and have not said that they do: since when, and why not. */
const wishes = new Map();

/** Have a robot stop. Resolves to what it says once it does; or to null where that has been withdrawn. */
export function stopRobot(name, service) {
  const known = wishes.get(name);
  if (known) return known.over;
  const wish = { service, since: performance.now(), asked: 0, problem: "" };
  wish.over = new Promise((resolve) => { wish.end = resolve; });
  wishes.set(name, wish);
  ask(name, wish);
  return wish.over;
}

/** It need not stop any more; whether it was to. */
export function withdraw(name) {
  const wish = wishes.get(name);
  wishes.delete(name);
  wish?.end(null);
  return wish !== undefined;
}

/** Whether a robot is to stop and has not confirmed it. */
export const isPending = (name) => wishes.has(name);

/** What is to be said of stops that nobody has confirmed; empty where there are none, or they are just on their way. */
export function unconfirmed() {
  const late = [...wishes].filter(([, { since, problem }]) => problem || performance.now() - since > SOON);
  return late.map(([name, { problem }]) => {
    const why = link.isAlive ? problem || "there is no answer" : "there is no link";
    return `EMERGENCY STOP OF ${name || "THE ROBOT"} NOT CONFIRMED: ${why}. It is asked again until it is.`;
  }).join(" ");
}

async function ask(name, wish) {
  if (wish.asked >= MOST) return;
  wish.asked++;
  try {
    const answer = await link.ask({ do: "call", service: wish.service, type: "std/Trigger" });
    if (answer.success === false) throw new Error(answer.message || "it says no");
    if (wishes.get(name) === wish) wishes.delete(name);
    wish.end({ ...answer, took: performance.now() - wish.since });
  } catch (error) {
    wish.problem = error.message;
  }
  wish.asked--;
}

setInterval(() => {
  for (const [name, wish] of wishes) ask(name, wish);
}, AGAIN);
