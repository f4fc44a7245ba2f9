// The plate from above, as the camera's table frame has it: origin at the centre, x right, y up, mm.

import { svg } from './dom.js';
import { colours } from './kinds.js';

const TRAIL_S = 6;
const LEAST_STEP_S = 0.08;
/** A part that seems to go farther than this between two observations, in mm, was taken for another. */
const JUMP_MM = 25;
/** A penny's, where the daemon does not tell, mm. */
const RADIUS_MM = 9.525;
const MARGIN_MM = 8;
/** Height of the names of bins, as a share of half the plate's side. */
const NAME = 0.066;

const TARGET = 'M-7 0H7M0 -7V7M4.5 0A4.5 4.5 0 1 1 -4.5 0A4.5 4.5 0 1 1 4.5 0';

const fixed = (mm) => Number(mm.toFixed(2));
const point = ([x, y]) => `${fixed(x)} ${fixed(-y)}`;
const NO_LAYOUT = { parts: [], targets_mm: [], bins: [], paths: [] };

export class View {
  constructor(name) {
    this.name = name;
    const group = (kind) => svg('g', { class: kind });
    [this.grid, this.bins, this.paths, this.trails, this.targets, this.parts] =
      ['grid', 'bins', 'paths', 'trails', 'targets', 'parts'].map(group);
    this.ways = svg('path', { class: 'ways' });
    this.steps = svg('path', { class: 'steps' });
    this.root = svg('svg', { class: 'view', role: 'img' });
    this.root.append(this.grid, this.bins, this.paths, this.ways, this.trails, this.targets, this.parts, this.steps);
    this.past = [];
    this.half = 0;
    this.layOut(NO_LAYOUT);
  }

  /** Draws bins and wanted paths; from now on parts are in the colours of their kinds. */
  layOut(layout) {
    this.layout = layout ?? NO_LAYOUT;
    this.colours = colours(this.layout.parts.map(({ kind }) => kind));
    this.bins.replaceChildren(...this.layout.bins.flatMap((bin) => this.bin(bin)));
    this.paths.replaceChildren(
      ...this.layout.paths.map(({ waypoints_mm: corners, closed }) =>
        svg('path', { class: 'wanted', d: `M${corners.map(point).join('L')}${closed ? 'Z' : ''}` })),
    );
  }

  bin({ kinds, parts = [], region_mm: { min, max } }) {
    const colour = kinds.length === 1 ? (this.colours.get(kinds[0]) ?? '') : '';
    const [width, height] = [max[0] - min[0], max[1] - min[1]];
    const box = svg('rect', { class: `bin ${colour}`, x: min[0], y: -max[1], width, height, rx: 2 });
    // above the bin, or below its top where the plate ends
    const size = fixed(NAME * this.half);
    const above = max[1] + size + 3 < this.half;
    const at = { x: min[0] + 1, y: above ? -max[1] - 3 : -max[1] + size, 'font-size': size };
    return [box, svg('text', { class: 'bin-name', ...at }, [...kinds, ...parts].join(', '))];
  }

  colourOf(part) {
    return this.colours.get(this.layout.parts[part]?.kind) ?? '';
  }

  /** Draws what was seen; `at` is when, in s of any steady clock. */
  draw({ job, positions_mm: positions, targets_mm: targets, side_mm: side, radii_mm: radii = [] }, at) {
    this.frame(side);
    this.remember(job, positions, at);
    this.drawTrails();
    this.drawTargets(positions, targets);
    this.drawParts(positions, radii);
    const count = (n, what) => `${n} ${what}${n === 1 ? '' : 's'}`;
    const bins = this.layout.bins.length ? `, ${count(this.layout.bins.length, 'bin')}` : '';
    const seen = `${count(positions.length, 'part')}, ${count(targets.length, 'target')}${bins}`;
    this.root.setAttribute('aria-label', `${this.name} from above: ${seen}`);
  }

  /** Draws the ways that parts were to go in the present motion, from and to. */
  foresee(ways) {
    this.steps.setAttribute('d', ways.map((ends) => `M${ends.map(point).join('L')}`).join(''));
  }

  /** Outline and lines every 50 mm. */
  frame(side) {
    const half = side / 2;
    if (half === this.half) return;
    const edge = (this.half = half) + MARGIN_MM;
    this.root.setAttribute('viewBox', `${-edge} ${-edge} ${2 * edge} ${2 * edge}`);
    const lines = [];
    for (let mm = -Math.floor(half / 50) * 50; mm <= half; mm += 50) {
      lines.push(svg('path', { class: mm ? 'line' : 'axis', d: `M${mm} ${-half}V${half}M${-half} ${mm}H${half}` }));
    }
    const outline = { x: -half, y: -half, width: 2 * half, height: 2 * half, rx: 3 };
    const at = { x: half - 4, y: half - 5, 'text-anchor': 'end', 'font-size': half * 0.07 };
    const size = svg('text', { class: 'scale', ...at }, `${Math.round(side * 10) / 10} mm`);
    this.grid.replaceChildren(svg('rect', { ...outline, class: 'plate' }), ...lines, size);
    this.layOut(this.layout);
  }

  remember(job, positions, at) {
    const last = this.past.at(-1);
    if (last && (last.job !== job || last.positions.length !== positions.length || at < last.at)) this.past = [];
    if (!last || at - last.at >= LEAST_STEP_S) this.past.push({ job, positions, at });
    this.past = this.past.filter((seen) => at - seen.at <= TRAIL_S);
  }

  drawTrails() {
    const way = (part) =>
      this.past.map(({ positions }, i) => {
        const [at, before] = [positions[part], this.past[i - 1]?.positions[part]];
        const goesOn = before && Math.hypot(at[0] - before[0], at[1] - before[1]) < JUMP_MM;
        return `${goesOn ? 'L' : 'M'}${point(at)}`;
      });
    const parts = this.past.at(-1)?.positions ?? [];
    const trail = (_, part) => svg('path', { class: `trail ${this.colourOf(part)}`, d: way(part).join('') });
    this.trails.replaceChildren(...parts.map(trail));
  }

  drawTargets(positions, targets) {
    const mark = (target) => svg('path', { class: 'target', d: TARGET, transform: `translate(${point(target)})` });
    this.targets.replaceChildren(...targets.map(mark));
    const pairs = positions.length === targets.length ? targets : [];
    this.ways.setAttribute('d', pairs.map((target, i) => `M${point(positions[i])}L${point(target)}`).join(''));
  }

  drawParts(positions, radii) {
    const part = (position, i) => {
      const radius = radii[i] ?? RADIUS_MM;
      const { id = '', kind = '' } = this.layout.parts[i] ?? {};
      // `penny-3` is the default, not a given name
      const name = !id || Number(id.slice(kind.length + 1)) ? String(i + 1) : id;
      const font = { 'text-anchor': 'middle', dy: '0.35em', 'font-size': radius * Math.min(1, 3 / name.length) };
      const at = { class: `part ${this.colourOf(i)}`, transform: `translate(${point(position)})` };
      return svg('g', at, svg('circle', { r: radius }), svg('text', font, name));
    };
    this.parts.replaceChildren(...positions.map(part));
  }
}
