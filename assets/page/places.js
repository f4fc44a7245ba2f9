// Where in a JSON text the member is that a path like `parts[1].kind` names. Reads what it can of a broken text.

const TOKEN = /"(?:[^"\\]|\\.)*"|[{}[\],:]|[^\s{}[\],:"]+/g;

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
  const found = new Map();
  // the lists and objects that are open, each with the index or the key it has come to
  const open = [];
  for (const { 0: token, index: at } of text.matchAll(TOKEN)) {
    const end = at + token.length;
    const around = open.at(-1);
    if (token === '}' || token === ']') {
      const closed = open.pop();
      if (closed) closed.place.end = end;
    } else if (token === ',' && around) {
      around.index += 1;
      around.key = undefined;
    } else if (around && !around.isList && around.key === undefined) {
      around.key = plainKey(token);
      around.start = at;
    } else if (token !== ',' && token !== ':') {
      const list = around?.isList && `${around.path === '$' ? '' : around.path}[${around.index}]`;
      const path = list || (around ? member(around.path, around.key) : '$');
      const place = { start: around?.isList === false ? around.start : at, value: at, end };
      found.set(path, place);
      if (token === '{' || token === '[') open.push({ path, place, isList: token === '[', index: 0 });
    }
  }
  return found;
}

const lineAt = (text, offset) => text.slice(0, offset).split('\n').length;

/** The line of a fault, from 1: where the text stops being JSON, otherwise that of its path or the member above it. */
export function lineOf(text, { position, path }, found = places(text)) {
  if (position) return Math.max(position.line, 1);
  const isAbove = (other) => path.startsWith(other) && /^($|[.[])/.test(path.slice(other.length));
  const above = [...found.keys()].filter(isAbove).sort((a, b) => b.length - a.length);
  return lineAt(text, found.get(above[0] ?? '$')?.start ?? 0);
}
