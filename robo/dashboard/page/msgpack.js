// MessagePack to values. https://github.com/msgpack/msgpack/blob/master/spec.md

const text = new TextDecoder();

class Reader {
  constructor(bytes) {
    this.bytes = bytes;
    this.view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    this.at = 0;
  }

  skip(size) {
    const at = this.at;
    this.at += size;
    if (this.at > this.bytes.length) throw new RangeError("the message is cut");
    return at;
  }

  words(size) {
    const at = this.skip(size);
    return text.decode(this.bytes.subarray(at, at + size));
  }

  data(size) {
    const at = this.skip(size);
    return this.bytes.subarray(at, at + size);
  }

  list(size) {
    const found = [];
    for (let i = 0; i < size; i++) found.push(this.value());
    return found;
  }

  map(size) {
    const found = Object.create(null);
    for (let i = 0; i < size; i++) {
      const name = this.value();
      found[name] = this.value();
    }
    return found;
  }

  value() {
    const view = this.view;
    const kind = view.getUint8(this.skip(1));
    if (kind < 0x80) return kind;
    if (kind < 0x90) return this.map(kind & 0x0f);
    if (kind < 0xa0) return this.list(kind & 0x0f);
    if (kind < 0xc0) return this.words(kind & 0x1f);
    if (kind >= 0xe0) return kind - 0x100;
    switch (kind) {
      case 0xc0: return null;
      case 0xc2: return false;
      case 0xc3: return true;
      case 0xc4: return this.data(view.getUint8(this.skip(1)));
      case 0xc5: return this.data(view.getUint16(this.skip(2)));
      case 0xc6: return this.data(view.getUint32(this.skip(4)));
      case 0xca: return view.getFloat32(this.skip(4));
      case 0xcb: return view.getFloat64(this.skip(8));
      case 0xcc: return view.getUint8(this.skip(1));
      case 0xcd: return view.getUint16(this.skip(2));
      case 0xce: return view.getUint32(this.skip(4));
      case 0xcf: return Number(view.getBigUint64(this.skip(8)));
      case 0xd0: return view.getInt8(this.skip(1));
      case 0xd1: return view.getInt16(this.skip(2));
      case 0xd2: return view.getInt32(this.skip(4));
      case 0xd3: return Number(view.getBigInt64(this.skip(8)));
      case 0xd9: return this.words(view.getUint8(this.skip(1)));
      case 0xda: return this.words(view.getUint16(this.skip(2)));
      case 0xdb: return this.words(view.getUint32(this.skip(4)));
      case 0xdc: return this.list(view.getUint16(this.skip(2)));
      case 0xdd: return this.list(view.getUint32(this.skip(4)));
      case 0xde: return this.map(view.getUint16(this.skip(2)));
      case 0xdf: return this.map(view.getUint32(this.skip(4)));
      default: throw new RangeError(`no such kind of value: ${kind}`);
    }
  }
}

/** A payload as values: MessagePack, or JSON, which begins with a brace. */
export function decode(bytes) {
  if (bytes[0] === 0x7b) return JSON.parse(text.decode(bytes));
  return new Reader(bytes).value();
}
