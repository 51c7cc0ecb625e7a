// The socket to the server: what it says goes to who listens, and what is asked of it has an answer.

import { decode } from "./msgpack.js";

/** Without a beat for so long the link is gone, ms. */
export const LOST = 1000;
/** After so long it is opened anew, whatever the browser still believes of it. */
const HOPELESS = 3000;
/** So long it may take to be opened: a machine that has much to do takes its time. */
const OPENING = 10_000;
const AGAIN = [200, 500, 1000, 2000];
const HEAD = 18;
/** What has been read is said together, ms; sooner where it is so much, bytes: the server waits for that. */
const TOGETHER = 50;
const MUCH = 50_000;
/** A server that has a request answers within eleven seconds: a stop may wait for an earlier one. */
const PATIENCE = 12_000;
/** Beats by which it is known how far this clock is from the server's: some 30 s. */
const BEATS = 300;

class Link {
  constructor() {
    this.listeners = new Map();
    /** By topic: who watches it, and what has come last. */
    this.watched = new Map();
    /** Of which robot it is wanted where its frames stand. */
    this.framesOf = null;
    this.channels = new Map();
    this.waiting = new Map();
    this.number = 0;
    this.tries = 0;
    this.beat = 0;
    this.beatAt = -Infinity;
    /** Whether this socket has brought a beat. */
    this.isHeard = false;
    this.offsets = [];
    this.offset = 0;
    this.lag = 0;
    this.read = 0;
    this.unread = 0;
    /** When it was said last what has been read. */
    this.saidAt = -Infinity;
    this.name = "";
    this.drives = false;
    /** The number of a grip that begins now: an emergency stop ends those of lower ones. */
    this.grip = 0;
    this.frames = 0;
    this.failures = 0;
    this.problem = "";
  }

  open() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/socket`);
    socket.binaryType = "arraybuffer";
    this.openedAt = performance.now();
    socket.onopen = () => {
      if (this.socket !== socket) return;
      this.tries = 0;
      this.openedAt = performance.now();
      this.problem = "";
      this.read = 0;
      this.channels.clear();
      this.sendWatched();
    };
    socket.onmessage = (event) => this.socket === socket && this.take(event.data);
    socket.onclose = () => this.socket === socket && this.lose();
    this.socket = socket;
  }

  /** The link is gone: who waits is told, and it is opened once more. */
  lose() {
    this.socket = null;
    this.isHeard = false;
    for (const { reject } of this.waiting.values()) reject(new Error("the link is gone"));
    this.waiting.clear();
    const pause = AGAIN[Math.min(this.tries++, AGAIN.length - 1)];
    setTimeout(() => this.open(), pause);
    if (this.tries > 1) this.askWhy();
  }

  /** A socket that is refused does not say why; a file does. */
  async askWhy() {
    try {
      const answer = await fetch("icon.svg", { cache: "no-store" });
      this.problem = answer.ok ? "" : (await answer.text()).trim();
    } catch (error) {
      this.problem = ""; // nobody is there
    }
  }

  /** See whether a socket that says nothing has to be given up. */
  look() {
    const since = Math.max(this.beatAt, this.openedAt ?? -Infinity);
    const patience = this.socket?.readyState === WebSocket.OPEN ? HOPELESS : OPENING;
    if (this.socket && performance.now() - since > patience) {
      const socket = this.socket;
      this.lose();
      socket.close();
    }
    const now = performance.now();
    for (const [id, asked] of this.waiting) {
      if (now - asked.at < PATIENCE) continue;
      this.waiting.delete(id);
      asked.reject(new Error("no answer"));
    }
  }

  /** How long nothing has come, ms. */
  get silence() {
    return performance.now() - this.beatAt;
  }

  /** Whether what comes is new: beats come, and have not been long on their way. */
  get isAlive() {
    return this.isHeard && this.silence + this.lag < LOST;
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

  /**
   * Have a function called with messages of a topic: (message, {type, arrived, …}). Returns what ends that.
   * With `types` only messages of these come, and of those only what can be read; without it all, and undefined for
   * what cannot. What has come last for somebody else comes at once: of a latched topic nothing may follow.
   */
  watch(key, types, listener) {
    const entry = { types, listener };
    if (!this.watched.has(key)) this.watched.set(key, { entries: new Set(), last: null });
    const topic = this.watched.get(key);
    topic.entries.add(entry);
    if (topic.last) queueMicrotask(() => topic.entries.has(entry) && topic.last && this.tell(entry, topic.last));
    this.watchSoon();
    return () => {
      topic.entries.delete(entry);
      if (topic.entries.size === 0 && this.watched.get(key) === topic) this.watched.delete(key);
      this.watchSoon();
    };
  }

  /** Have the news `frames` of a robot, and of no other one. */
  watchFrames(robot) {
    this.framesOf = robot;
    this.watchSoon();
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
    const frames = this.framesOf === null ? [] : [this.framesOf];
    this.send({ do: "watch", keys: [...this.watched.keys()], frames });
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
      else this.waiting.set(id, { resolve, reject, at: performance.now() });
    });
  }

  take(data) {
    this.read++;
    if (!this.isReadDue) {
      // Some at once, and after they have been drawn: a browser that is slow gets less, and that newer. A page that
      // nobody sees draws nothing, and its clocks hardly run: what comes next, a beat at the latest, says it there.
      if (document.visibilityState === "visible") {
        this.isReadDue = true;
        setTimeout(() => requestAnimationFrame(() => this.acknowledge()), TOGETHER);
        setTimeout(() => this.acknowledge(), 5 * TOGETHER);
      } else if (performance.now() - this.saidAt >= TOGETHER) this.acknowledge();
    }
    this.unread += data.length ?? data.byteLength;
    if (this.unread > MUCH && !this.isSoon && document.visibilityState === "visible") {
      this.isSoon = true;
      requestAnimationFrame(() => this.acknowledge());
    }
    if (typeof data === "string") this.hear(JSON.parse(data));
    else this.deliver(data);
  }

  acknowledge() {
    this.isReadDue = this.isSoon = false;
    this.unread = 0;
    this.saidAt = performance.now();
    if (this.read === 0) return;
    this.send({ do: "read", count: this.read });
    this.read = 0;
  }

  hear(news) {
    if (news.kind === "beat") this.hearBeat(news);
    else if (news.kind === "channel") this.channels.set(news.number, news);
    else if (news.kind === "welcome") {
      this.name = news.name;
      this.drives = news.drives;
      this.offsets = [];
    }
    if (news.kind === "drivers") this.grip = news.grip;
    const asked = news.id === undefined || news.id === null ? undefined : this.waiting.get(news.id);
    if (asked !== undefined) {
      this.waiting.delete(news.id);
      if (news.kind === "answer") asked.resolve(news.answer);
      else asked.reject(new Error(news.reason));
      return;
    }
    for (const listener of this.listeners.get(news.kind) ?? []) this.guarded(() => listener(news));
  }

  /** The beat that came the quickest tells the server's time; by it, how long another one was on its way. */
  hearBeat({ number, time }) {
    this.beat = number;
    this.isHeard = true;
    this.beatAt = performance.now();
    const offset = time - this.beatAt;
    this.offsets.push(offset);
    if (this.offsets.length > BEATS) this.offsets.shift();
    this.offset = Math.max(...this.offsets);
    this.lag = this.offset - offset;
  }

  deliver(data) {
    this.frames++;
    const head = new DataView(data);
    const channel = this.channels.get(head.getUint16(0, true));
    const topic = channel && this.watched.get(channel.key);
    if (!topic) return;
    const type = channel.encoding.split(";")[1] ?? "";
    let message;
    try {
      message = decode(new Uint8Array(data, HEAD));
    } catch (error) {
      message = undefined; // who shows any message says so
    }
    const about = {
      type,
      published: head.getFloat64(2, true),
      arrived: head.getFloat64(10, true),
      size: data.byteLength - HEAD,
    };
    topic.last = { message, about };
    for (const entry of [...topic.entries]) this.tell(entry, topic.last);
  }

  tell({ types, listener }, { message, about }) {
    if (types && (message === undefined || message === null || !types.includes(about.type))) return;
    this.guarded(() => listener(message, about));
  }

  /** A message may lie about its type: who cannot show it holds up nobody else. */
  guarded(work) {
    try {
      work();
    } catch (error) {
      this.failures++;
      this.failure = error;
    }
  }
}

export const link = new Link();
setInterval(() => link.look(), 250);
document.addEventListener("visibilitychange", () => link.acknowledge());
