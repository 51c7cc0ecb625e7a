// The picture of a camera: as JPEGs or PNGs, or as plain pixels.

import { el, say } from "../dom.js";
import { link } from "../link.js";
import { ageOf, panel } from "../panel.js";
import { robot } from "../robot.js";

const MOST_PIXELS = 2 ** 24;
const TYPES = ["sensor/CompressedImage", "sensor/Image"];

/** The panel of the camera. */
export function camera() {
  const choice = el("select", { "aria-label": "Camera", hidden: true, onchange: () => choose(choice.value) });
  const canvas = el("canvas", { role: "img", "aria-label": "Picture of the camera" });
  const told = el("p", { class: "told" }, "no camera");
  let at = null;
  let end = () => {};
  let watched = "";
  let drawn = 0;
  let isSeen = false;
  let busy = false;

  /** Watch a camera, while there is somebody to see it: pictures are large. */
  function choose(key) {
    end();
    end = () => {};
    watched = key;
    at = null;
    // What another camera has shown is not this one's.
    canvas.width = canvas.height = 0;
    canvas.hidden = true;
    say(told, key ? `no picture yet from ${key}` : "no camera");
    if (!key || !isSeen) return;
    end = link.watch(key, TYPES, async (message, { arrived, type }) => {
      if (busy) return; // the next one is newer
      busy = true;
      try {
        if (type === "sensor/CompressedImage") {
          const picture = await createImageBitmap(new Blob([message.data]));
          if (key === watched) compressed(canvas, picture);
          picture.close();
        } else plain(canvas, message);
        if (key !== watched) return;
        canvas.hidden = false;
        at = arrived;
        drawn += 1;
        canvas.dataset.drawn = String(drawn);
        say(told, "");
      } catch (error) {
        if (key === watched) say(told, `no picture: ${error.message}`);
      } finally {
        busy = false;
      }
    });
  }

  link.on("picture", () => {
    const there = robot.topics.filter((one) => TYPES.includes(one.type) && one.publishers.length).map((one) => one.key);
    there.sort((a, b) => Number(b.endsWith("compressed")) - Number(a.endsWith("compressed")));
    if (there.join() === [...choice.options].map((one) => one.value).join()) return;
    const before = choice.value;
    choice.replaceChildren(...there.map((key) => el("option", { value: key }, key)));
    choice.value = there.includes(before) ? before : there[0] ?? "";
    choice.hidden = there.length === 0;
    if (choice.value !== before || !there.length) choose(choice.value);
  });
  robot.onChange(() => {
    choice.replaceChildren();
    choose("");
  });
  const made = panel("camera", "Camera", [choice, ageOf(() => at, 1000, () => "")], canvas, told);
  function see(inView) {
    const seen = inView && document.visibilityState === "visible";
    if (seen === isSeen) return;
    isSeen = seen;
    choose(choice.value);
  }
  let inView = false;
  new IntersectionObserver((entries) => {
    inView = entries.at(-1).isIntersecting;
    see(inView);
  }).observe(made);
  document.addEventListener("visibilitychange", () => see(inView));
  return made;
}

function compressed(canvas, picture) {
  canvas.width = picture.width;
  canvas.height = picture.height;
  canvas.getContext("2d").drawImage(picture, 0, 0);
}

function plain(canvas, { width, height, encoding, step, data }) {
  const channels = { rgb8: [0, 1, 2], bgr8: [2, 1, 0], rgba8: [0, 1, 2], bgra8: [2, 1, 0], mono8: [0, 0, 0] }[encoding];
  if (!channels) throw new Error(`pixels as ${encoding} are not shown`);
  if (!(width > 0 && height > 0 && width * height <= MOST_PIXELS)) throw new Error(`${width} × ${height} pixels are not shown`);
  const size = { mono8: 1, rgba8: 4, bgra8: 4 }[encoding] ?? 3;
  if (data.length < step * height) throw new Error("it is cut");
  const pen = Object.assign(canvas, { width, height }).getContext("2d");
  const image = pen.createImageData(width, height);
  const [r, g, b] = channels;
  for (let y = 0, to = 0; y < height; y++) {
    for (let x = 0, from = y * step; x < width; x++, from += size, to += 4) {
      image.data[to] = data[from + r];
      image.data[to + 1] = data[from + g];
      image.data[to + 2] = data[from + b];
      image.data[to + 3] = 255;
    }
  }
  pen.putImageData(image, 0, 0);
}
