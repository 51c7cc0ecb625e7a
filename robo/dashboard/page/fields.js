// Parts of messages: which numbers there are, and their values.

const MOST = 500;
const LONGEST_LIST = 12;

/** The names of all numbers of a message: `pose.pose.position.x`, `velocity[0]`. */
export function numbers(message) {
  const found = [];
  collect(message, "", found);
  return found;
}

function collect(value, name, found) {
  if (found.length >= MOST) return;
  if (typeof value === "number" || typeof value === "boolean") found.push(name);
  else if (Array.isArray(value)) value.slice(0, LONGEST_LIST).forEach((item, i) => collect(item, `${name}[${i}]`, found));
  else if (value && typeof value === "object" && !ArrayBuffer.isView(value)) {
    for (const [key, item] of Object.entries(value)) collect(item, name ? `${name}.${key}` : key, found);
  }
}

/** The value of a part; undefined where there is none. */
export function part(message, name) {
  let value = message;
  for (const word of name.split(/[.[\]]+/).filter(Boolean)) value = value?.[word];
  return typeof value === "boolean" ? Number(value) : value;
}

/** A message as lines of text, with units where they are known, and with long lists cut. */
export function shown(value, type = "", name = "", indent = "") {
  if (ArrayBuffer.isView(value)) return `${value.byteLength} bytes`;
  if (Array.isArray(value)) {
    const left = value.length > LONGEST_LIST ? value.length : 0;
    if (value.every((item) => typeof item !== "object" || item === null)) {
      const some = value.slice(0, LONGEST_LIST).map(plain).join(", ");
      return withUnit(left ? `[${some}, … ${left} in all]` : `[${some}]`, value[0], type, name);
    }
    const some = value.slice(0, LONGEST_LIST).map((item) => `\n${indent}- ${shown(item, type, name, `${indent}  `).trimStart()}`).join("");
    return left ? `${some}\n${indent}… ${left} in all` : some;
  }
  if (value && typeof value === "object") {
    return Object.entries(value).map(([key, item]) => {
      const text = shown(item, type, name ? `${name}.${key}` : key, `${indent}  `);
      return `\n${indent}${key}:${text.startsWith("\n") ? "" : " "}${text}`;
    }).join("");
  }
  return withUnit(plain(value), value, type, name);
}

function withUnit(text, value, type, name) {
  const of = typeof value === "number" ? unit(type, name) : "";
  return of ? `${text} ${of}` : text;
}

function plain(value) {
  return typeof value === "number" && !Number.isInteger(value) ? String(Number(value.toPrecision(6))) : String(value);
}

/** Units of numbers by what their names end in, as ROS's messages have them: the first that fits. */
const UNITS = [
  [/(^|\.)(sec)$/, "s"], [/(^|\.)nanosec$/, "ns"], [/orientation|rotation|covariance/, ""],
  [/acceleration/, "m/s²"], [/angular(_velocity)?\.[xyz]$/, "rad/s"], [/linear(_velocity)?\.[xyz]$/, "m/s"],
  [/angle/, "rad"], [/range/, "m"], [/(position|translation|point|origin)\.[xyz]$/, "m"],
  [/voltage$/, "V"], [/current$/, "A"], [/temperature$/, "°C"], [/(scan_time|time_increment)$/, "s"],
];

/** The unit of a number of a message; empty where it has none, or it is not known. */
export function unit(type, name) {
  if (["geometry/Point", "geometry/PointStamped"].includes(type) && /(^|\.)[xyz]$/.test(name)) return "m";
  return UNITS.find(([pattern]) => pattern.test(name))?.[1] ?? "";
}
