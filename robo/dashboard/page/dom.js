// Elements of the page. What robots say is only ever set as text.

/** An element: attributes, `on...` handlers, then children, of which words become text. */
export function el(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === undefined || value === false) continue;
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (name === "class") made.className = value;
    else made.setAttribute(name, value === true ? "" : plain(value));
  }
  made.append(...children.filter((one) => one !== null && one !== undefined).map((one) => (typeof one === "string" ? plain(one) : one)));
  return made;
}

/** Set the text of an element, where it is another one: a screen reader reads only what changes. */
export function say(element, words) {
  const shown = plain(words);
  if (element.textContent !== shown) element.textContent = shown;
}

/** Words as they are, but for what would make them look like others: codes of terminals, signs that turn the line. */
export function plain(words) {
  return String(words).replace(/[\u0000-\u0008\u000b-\u001f\u007f-\u009f\u200b-\u200f\u2028-\u202e\u2066-\u2069\ufeff]/g, escaped);
}

function escaped(sign) {
  const code = sign.charCodeAt(0);
  return code < 256 ? `\\x${code.toString(16).padStart(2, "0")}` : `\\u${code.toString(16).padStart(4, "0")}`;
}

/** Rows that stay where they are while their values change. `fill(row, item)` sets them; `make(item)` makes one. */
export class Rows {
  constructor(parent, key, make, fill) {
    Object.assign(this, { parent, key, make, fill, rows: new Map() });
  }

  show(items) {
    // Those that are gone first: no other row is moved then, and the focus and a click that is half done stay.
    const wanted = new Set(items.map(this.key));
    for (const [name, row] of this.rows) {
      if (wanted.has(name)) continue;
      row.remove();
      this.rows.delete(name);
    }
    let before = null;
    for (const item of items) {
      const name = this.key(item);
      let row = this.rows.get(name);
      if (row === undefined) {
        row = this.make(item);
        this.rows.set(name, row);
      }
      this.fill(row, item);
      const place = before === null ? this.parent.firstChild : before.nextSibling;
      if (place !== row) this.parent.insertBefore(row, place);
      before = row;
    }
  }
}

/** A number with as many digits as are of use. */
export function number(value, digits = 2) {
  if (value === null || value === undefined) return "–";
  if (!Number.isFinite(value)) return String(value);
  return Math.abs(value) < 1e9 ? value.toFixed(digits).replace(/^-(0\.?0*)$/, "$1") : value.toExponential(digits);
}

/** How long ago something was, in words. */
export function age(ms) {
  if (ms === null || !Number.isFinite(ms)) return "never";
  if (ms < 950) return `${(ms / 1000).toFixed(1)} s`;
  if (ms < 100_000) return `${Math.round(ms / 1000)} s`;
  return ms < 6_000_000 ? `${Math.round(ms / 60_000)} min` : `${Math.round(ms / 3_600_000)} h`;
}

/** Bytes in words. */
export function size(bytes) {
  if (bytes === null || bytes === undefined) return "–";
  return bytes < 1e6 ? `${Math.round(bytes / 1e3)} kB` : `${Math.round(bytes / 1e6)} MB`;
}

/** A time of day. */
export function clock(ms) {
  return new Date(ms).toLocaleTimeString(undefined, { hour12: false });
}
