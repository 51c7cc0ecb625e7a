// Brings the page up: it needs no other file, so that what cannot be had is said, and asked for again.

(() => {
  const AGAIN = 2000;
  const lost = document.getElementById("lost");

  function say(words) {
    lost.textContent = words;
    lost.hidden = false;
  }

  /** Begin anew once the server answers: a part that has failed stays so in a page that is open. */
  async function anew() {
    try {
      if ((await fetch("icon.svg", { cache: "no-store" })).ok) {
        location.reload();
        return;
      }
    } catch (error) {
      // nobody is there
    }
    setTimeout(anew, AGAIN);
  }

  /** The style sheet; without it the emergency stop would not stay in view. */
  function style() {
    const sheet = document.querySelector("link[rel=stylesheet]");
    // Browsers differ in what a sheet is that has failed; what it does is the same.
    if (getComputedStyle(document.querySelector("header")).position === "sticky") return;
    const other = sheet.cloneNode();
    other.addEventListener("error", () => setTimeout(style, AGAIN));
    sheet.replaceWith(other);
  }

  import("./main.js").then(
    () => document.getElementById("loading").remove(),
    () => {
      say("A part of the page could not be loaded. It is loaded again.");
      setTimeout(anew, AGAIN);
    },
  );
  addEventListener("load", style);
})();
