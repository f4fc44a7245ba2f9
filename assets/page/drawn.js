// A job out of what was drawn on a plate: targets become an `arrange`, bins a `sort`. Places are in mm.

/** Targets in the order of the job: those of a kind together, kinds in the order in which they came. */
export function inJobOrder(targets) {
  const kinds = [...new Set(targets.map(({ kind }) => kind))];
  return kinds.flatMap((kind) => targets.filter((target) => target.kind === kind));
}

/** Items on one line; a line break within a string would be written as `\n`. */
const list = (items) => items.map((item) => JSON.stringify(item, null, 1).replace(/\n */g, ' ')).join(', ');

/** The text of a job that brings a part to each of `targets`. */
export function arrangeOf(targets, plate) {
  const ordered = inJobOrder(targets);
  const kinds = [...new Set(ordered.map(({ kind }) => kind))];
  const parts = kinds.map((kind) => ({ kind, count: ordered.filter((target) => target.kind === kind).length }));
  return text(plate, parts, 'arrange', 'targets_mm', ordered.map(({ at }) => list([at])));
}

/** The text of a job that brings the parts of every bin into it. */
export function sortOf(bins, plate) {
  const parts = bins.map(({ kind, count }) => ({ kind, count }));
  const region = ({ kind, min, max }) => list([{ kinds: [kind], region_mm: { min, max } }]);
  return text(plate, parts, 'sort', 'bins', bins.map(region));
}

function text(plate, parts, task, member, lines) {
  return `{
  "name": "drawn",
  "plate": ${JSON.stringify(plate)},
  "parts": [${list(parts)}],
  "task": {
    "type": "${task}",
    "${member}": [
      ${lines.join(',\n      ')}
    ]
  }
}
`;
}

/** Which of the marks, in the order of the job, the fault at `path` is about; null for none of them. */
export function markOf(path) {
  const found = /^task\.(?:targets_mm|bins)\[(\d+)\]/.exec(path);
  return found ? Number(found[1]) : null;
}
