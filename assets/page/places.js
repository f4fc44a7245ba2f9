// Where in a JSON text the member is that a path like `parts[1].kind` names. Reads what it can of a broken text.

const SPACE = /[\s]*/y;
const STRING = /"(?:[^"\\]|\\.)*"/y;
const SCALAR = /[^\s,\]}:]+/y;

class Reader {
  constructor(text) {
    this.text = text;
    this.at = 0;
    this.found = new Map();
  }

  skip(pattern) {
    pattern.lastIndex = this.at;
    const match = pattern.exec(this.text);
    if (match) this.at = pattern.lastIndex;
    return match?.[0];
  }

  next() {
    this.skip(SPACE);
    return this.text[this.at];
  }

  /** Reads a value; false where the text cannot be followed any further. */
  value(path, depth, start) {
    const first = this.next();
    if (first === undefined || depth > 100) return false;
    const from = this.at;
    this.found.set(path, { start: start ?? from, value: from, end: from });
    const read = first === '{' ? this.members(path, depth) : first === '[' ? this.elements(path, depth) : this.plain();
    if (read) this.found.get(path).end = this.at;
    return read;
  }

  plain() {
    return this.skip(this.text[this.at] === '"' ? STRING : SCALAR) !== undefined;
  }

  members(path, depth) {
    this.at += 1;
    for (;;) {
      if (this.next() === '}') break;
      const start = this.at;
      const key = this.skip(STRING);
      if (key === undefined || this.next() !== ':') return false;
      this.at += 1;
      if (!this.value(member(path, plainKey(key)), depth + 1, start)) return false;
      if (this.next() !== ',') break;
      this.at += 1;
    }
    return this.close('}');
  }

  elements(path, depth) {
    this.at += 1;
    for (let index = 0; this.next() !== ']'; index += 1) {
      if (!this.value(`${path === '$' ? '' : path}[${index}]`, depth + 1)) return false;
      if (this.next() !== ',') break;
      this.at += 1;
    }
    return this.close(']');
  }

  close(bracket) {
    if (this.next() !== bracket) return false;
    this.at += 1;
    return true;
  }
}

/** The path of a member, written as the daemon writes it. */
function member(path, name) {
  const above = path === '$' ? '' : path;
  if (!/^[\w-]+$/.test(name)) return `${above}[${JSON.stringify(name)}]`;
  return above ? `${above}.${name}` : name;
}

function plainKey(quoted) {
  try {
    return JSON.parse(quoted);
  } catch {
    return quoted.slice(1, -1);
  }
}

/** Every value of the text by its path: where its member starts, where the value starts and ends. */
export function places(text) {
  const reader = new Reader(text);
  reader.value('$', 0);
  return reader.found;
}

const lineAt = (text, offset) => text.slice(0, offset).split('\n').length;

/** The last step of a path: a member, an index, or a quoted key that is no plain word. */
const LAST_STEP = /(^|\.)[^.[\]]*$|\[\d+\]$|\["(?:[^"\\]|\\.)*"\]$/;

/** The line of a fault, from 1: where the text stops being JSON, otherwise that of its path or the member above it. */
export function lineOf(text, fault, found = places(text)) {
  if (fault.position) return Math.max(fault.position.line, 1);
  for (let path = fault.path; path !== '' && path !== '$';) {
    if (found.has(path)) return lineAt(text, found.get(path).start);
    const above = path.replace(LAST_STEP, '');
    // a path that was cut short has no end that could be taken off
    if (above === path) break;
    path = above;
  }
  return lineAt(text, found.get('$')?.start ?? 0);
}

/** The text with its top-level member `name` set to the string `value`, or without it where `value` is empty. */
export function withMember(text, name, value) {
  const found = places(text);
  const root = found.get('$');
  const member = found.get(name);
  if (!root || text[root.value] !== '{') return text;
  const quoted = JSON.stringify(value);
  if (member && value) return text.slice(0, member.value) + quoted + text.slice(member.end);
  if (member) return without(text, member);
  if (!value) return text;
  const first = [...found].find(([path]) => path !== '$' && !/[.[]/.test(path))?.[1];
  if (!first) return `${text.slice(0, root.value + 1)}"${name}": ${quoted}${text.slice(root.value + 1)}`;
  const gap = text.slice(root.value + 1, first.start);
  return `${text.slice(0, first.end)},${gap}"${name}": ${quoted}${text.slice(first.end)}`;
}

/** Takes a member away with the comma after it or, where there is none, the one before it. */
function without(text, member) {
  const after = /^\s*,\s*/.exec(text.slice(member.end));
  if (after) return text.slice(0, member.start) + text.slice(member.end + after[0].length);
  return text.slice(0, member.start).replace(/,?\s*$/, '') + text.slice(member.end);
}
