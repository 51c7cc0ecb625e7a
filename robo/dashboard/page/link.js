// The socket to the server: what it says goes to who listens, and what is asked of it has an answer.

import { decode } from "./msgpack.js";

/** Without a beat for so long the link is gone, ms. */
export const LOST = 1000;
const AGAIN = [200, 500, 1000, 2000];
const HEAD = 18;

class Link {
  constructor() {
    this.listeners = new Map();
    this.watched = new Map();
    this.channels = new Map();
    this.waiting = new Map();
    this.number = 0;
    this.tries = 0;
    this.beat = 0;
    this.beatAt = -Infinity;
    this.offset = 0;
    this.read = 0;
    this.name = "";
    this.drives = false;
    this.frames = 0;
  }

  open() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/socket`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.tries = 0;
      this.channels.clear();
      this.sendWatched();
    };
    socket.onmessage = (event) => this.take(event.data);
    socket.onclose = () => {
      if (this.socket !== socket) return;
      this.beatAt = -Infinity;
      for (const { reject } of this.waiting.values()) reject(new Error("the link is gone"));
      this.waiting.clear();
      setTimeout(() => this.open(), AGAIN[Math.min(this.tries++, AGAIN.length - 1)]);
    };
    this.socket = socket;
  }

  /** How long nothing has come, ms. */
  get silence() {
    return performance.now() - this.beatAt;
  }

  get isAlive() {
    return this.silence < LOST;
  }

  /** The server's time of now, ms since the epoch: by it ages are told, whatever this machine's clock says. */
  get now() {
    return performance.now() + this.offset;
  }

  /** Have a function called with news of a kind. */
  on(kind, listener) {
    if (!this.listeners.has(kind)) this.listeners.set(kind, []);
    this.listeners.get(kind).push(listener);
  }

  /** Have a function called with messages of a topic: (message, {published, arrived}). Returns what ends that. */
  watch(key, listener) {
    if (!this.watched.has(key)) this.watched.set(key, new Set());
    const listeners = this.watched.get(key);
    listeners.add(listener);
    this.watchSoon();
    return () => {
      listeners.delete(listener);
      if (listeners.size === 0 && this.watched.get(key) === listeners) this.watched.delete(key);
      this.watchSoon();
    };
  }

  watchSoon() {
    if (this.isWatchDue) return;
    this.isWatchDue = true;
    queueMicrotask(() => {
      this.isWatchDue = false;
      this.sendWatched();
    });
  }

  sendWatched() {
    this.send({ do: "watch", keys: [...this.watched.keys()] });
  }

  /** Tell the server something; whether there is a link. */
  send(request) {
    if (this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(request));
    return true;
  }

  /** Ask the server for something. */
  ask(request) {
    return new Promise((resolve, reject) => {
      const id = ++this.number;
      if (!this.send({ ...request, id })) reject(new Error("there is no link"));
      else this.waiting.set(id, { resolve, reject });
    });
  }

  take(data) {
    this.read++;
    if (!this.isReadDue) {
      this.isReadDue = true;
      // After what came has been drawn: a browser that is slow gets less, and that newer.
      requestAnimationFrameOrSoon(() => {
        this.isReadDue = false;
        this.send({ do: "read", count: this.read });
        this.read = 0;
      });
    }
    if (typeof data === "string") this.hear(JSON.parse(data));
    else this.deliver(data);
  }

  hear(news) {
    if (news.kind === "beat") {
      this.beat = news.number;
      this.beatAt = performance.now();
      this.offset = news.time - this.beatAt;
    } else if (news.kind === "channel") {
      this.channels.set(news.number, news);
    } else if (news.kind === "welcome") {
      this.name = news.name;
      this.drives = news.drives;
    }
    const asked = news.id === undefined || news.id === null ? undefined : this.waiting.get(news.id);
    if (asked !== undefined) {
      this.waiting.delete(news.id);
      if (news.kind === "answer") asked.resolve(news.answer);
      else asked.reject(new Error(news.reason));
      return;
    }
    for (const listener of this.listeners.get(news.kind) ?? []) listener(news);
  }

  deliver(data) {
    this.frames++;
    const head = new DataView(data);
    const channel = this.channels.get(head.getUint16(0, true));
    const listeners = channel && this.watched.get(channel.key);
    if (!listeners) return;
    let message;
    try {
      message = decode(new Uint8Array(data, HEAD));
    } catch (error) {
      message = undefined;
    }
    const about = {
      type: channel.encoding.split(";")[1] ?? "",
      published: head.getFloat64(2, true),
      arrived: head.getFloat64(10, true),
      size: data.byteLength - HEAD,
    };
    for (const listener of [...listeners]) listener(message, about);
  }
}

/** Before the next picture; soon where no pictures are drawn, since nobody looks. */
function requestAnimationFrameOrSoon(work) {
  if (document.visibilityState === "visible") requestAnimationFrame(work);
  else setTimeout(work, 100);
}

export const link = new Link();
