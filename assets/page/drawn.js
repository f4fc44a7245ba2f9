// A job out of what was drawn on a plate, in mm: targets, start places and corners of closed paths.

/** Speed along drawn paths; the dry run tells whether it can be held. */
const SPEED_MM_S = 10;

const kindsOf = (marks) => [...new Set(marks.map(({ kind }) => kind))];

/** Marks in the order of the job: those of a kind together, kinds in the order in which they came. */
export const inJobOrder = (marks) => kindsOf(marks).flatMap((kind) => marks.filter((mark) => mark.kind === kind));

/** The corners of each path. A path with a radius is a circle about its only corner. */
export function pathsOf(marks) {
  const corners = marks.filter(({ use }) => use === 'path');
  return [...new Set(corners.map(({ path }) => path))].map((number) => corners.filter(({ path }) => path === number));
}

const courseOf = ([{ at, radius }, ...more]) =>
  radius ? { circle: { center_mm: at, radius_mm: radius } } : { waypoints_mm: [at, ...more.map((corner) => corner.at), at] };

/** The job that has a part follow each path, or brings one to each target where there is no path. */
export function jobOf(marks, plate) {
  const of = (use, kind) => marks.filter((mark) => mark.use === use && mark.kind === (kind ?? mark.kind));
  const paths = pathsOf(marks);
  const goals = paths.length ? paths.map(([first]) => first) : of('target');
  const parts = kindsOf([...goals, ...of('start')]).flatMap((kind) => {
    const starts = of('start', kind).map(({ at }) => ({ kind, position_mm: at }));
    const count = goals.filter((goal) => goal.kind === kind).length - starts.length;
    return count > 0 ? [...starts, { kind, count }] : starts;
  });
  const follow = paths.map((corners) => ({ ...courseOf(corners), speed_mm_s: SPEED_MM_S }));
  const arrange = { type: 'arrange', targets_mm: goals.map(({ at }) => at) };
  return { name: 'drawn', plate, parts, task: paths.length ? { type: 'trajectories', paths: follow } : arrange };
}

/** A job's text, with what holds no list or object on one line. */
export function textOf(job) {
  const inOneLine = (flat) => flat.replace(/\n\s*/g, ' ').replace(/^([[{]) | ([\]}])$/g, '$1$2');
  return `${JSON.stringify(job, null, 2).replace(/[[{]\n\s*[^[\]{}]+[\]}]/g, inOneLine)}\n`;
}

/** Which of the marks the fault at `path` of their job is about, if any. */
export function markOf(path, job, marks) {
  const around = (path.match(/\w+/g) ?? []).reduce(([value, ...above], step) => [value?.[step], value, ...above], [job]);
  const places = (value) => [value, value?.position_mm, value?.waypoints_mm?.[0], value?.circle?.center_mm];
  return around.map((value) => marks.find(({ at }) => places(value).includes(at))).find(Boolean);
}

/** A job whose targets the daemon places by a rule: letters, a ring or a grid of `count` parts, `size` mm tall. */
export function madeBy(shape, { kind, plate, text, count, size }) {
  const columns = Math.ceil(Math.sqrt(count));
  const rules = {
    letters: { text: { string: text, height_mm: size } },
    ring: { circle: { radius_mm: size / 2 } },
    grid: { grid: { columns, spacing_mm: size / Math.max(columns - 1, 1) } },
  };
  return { name: 'drawn', plate, parts: [{ kind, count }], task: { type: 'arrange', targets: rules[shape] } };
}
