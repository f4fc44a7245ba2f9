// A job out of targets that were drawn on a plate, in mm.

const kindsOf = (targets) => [...new Set(targets.map(({ kind }) => kind))];

/** Targets in the order of the job: those of a kind together, kinds in the order in which they came. */
export const inJobOrder = (targets) => kindsOf(targets).flatMap((kind) => targets.filter((target) => target.kind === kind));

/** The text of a job that brings a part to each of `targets`. */
export function arrangeOf(targets, plate) {
  const parts = kindsOf(targets).map((kind) => ({ kind, count: targets.filter((target) => target.kind === kind).length }));
  const task = { type: 'arrange', targets_mm: inJobOrder(targets).map(({ at }) => at) };
  const text = JSON.stringify({ name: 'drawn', plate, parts, task }, null, 2);
  // a place on one line
  return `${text.replace(/\[\s+(-?[\d.]+),\s+(-?[\d.]+)\s+\]/g, '[$1, $2]')}\n`;
}

/** Which of the targets, in the order of the job, the fault at `path` is about; null for none of them. */
export function markOf(path) {
  const found = /^task\.targets_mm\[(\d+)\]/.exec(path);
  return found ? Number(found[1]) : null;
}
