// The plate from above, as the camera's table frame has it: origin at the centre, x right, y up, mm.

import { setChildren, svg } from './dom.js';
import { colours } from './kinds.js';

const TRAIL_S = 6;
const BANDS = 3;
const LEAST_STEP_S = 0.08;
/** A part that seems to go farther than this between two observations, in mm, was taken for another. */
const JUMP_MM = 25;
/** A penny's, where the daemon does not tell, mm. */
const RADIUS_MM = 9.525;
const MARGIN_MM = 8;
/** Height of the names of bins, as a share of half the plate's side. */
const NAME = 0.066;

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
    this.root = svg('svg', { class: 'view', role: 'img' });
    this.root.append(this.grid, this.bins, this.paths, this.ways, this.trails, this.targets, this.parts);
    [this.marks, this.coins, this.past] = [[], [], []];
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

  bin({ kinds, region_mm: { min, max } }) {
    const colour = kinds.length === 1 ? (this.colours.get(kinds[0]) ?? '') : '';
    const [width, height] = [max[0] - min[0], max[1] - min[1]];
    const box = svg('rect', { class: `bin ${colour}`, x: min[0], y: -max[1], width, height, rx: 2 });
    // above the bin, or below its top where the plate ends
    const size = fixed(NAME * (this.half || 150));
    const above = !this.half || max[1] + size + 3 < this.half;
    const name = svg('text', { class: 'bin-name', x: min[0] + 1, y: above ? -max[1] - 3 : -max[1] + size, 'font-size': size });
    name.textContent = kinds.join(', ');
    return [box, name];
  }

  colourOf(part) {
    return this.colours.get(this.layout.parts[part]?.kind) ?? '';
  }

  /** Draws what was seen; `at` is when, in s of any steady clock. */
  draw({ job, positions_mm: positions, targets_mm: targets, side_mm: side, radii_mm: radii = [] }, at) {
    this.frame(side, [...positions, ...targets]);
    this.remember(job, positions, at);
    this.drawTrails(at);
    this.drawTargets(positions, targets);
    this.drawParts(positions, radii);
    const count = (n, what) => `${n} ${what}${n === 1 ? '' : 's'}`;
    const seen = `${count(positions.length, 'part')}, ${count(targets.length, 'target')}`;
    const bins = this.layout.bins.length ? `, ${count(this.layout.bins.length, 'bin')}` : '';
    const label = `${this.name} from above: ${seen}${bins}`;
    if (this.root.getAttribute('aria-label') !== label) this.root.setAttribute('aria-label', label);
  }

  /** Outline and lines every 50 mm. A plate of unknown size has no outline. */
  frame(side, places) {
    const reach = Math.max(0, ...places.flat().map(Math.abs)) + RADIUS_MM;
    const half = side ? side / 2 : Math.max(this.half, reach > 102 ? 152.4 : 101.6, reach);
    if (half === this.half) return;
    this.half = half;
    const edge = half + MARGIN_MM;
    this.root.setAttribute('viewBox', `${-edge} ${-edge} ${2 * edge} ${2 * edge}`);
    const lines = [];
    for (let mm = -Math.floor(half / 50) * 50; mm <= half; mm += 50) {
      const kind = mm === 0 ? 'axis' : 'line';
      lines.push(svg('path', { class: kind, d: `M${mm} ${-half}V${half}M${-half} ${mm}H${half}` }));
    }
    const outline = { x: -half, y: -half, width: 2 * half, height: 2 * half, rx: 3 };
    const plate = svg('rect', { ...outline, class: side ? 'plate' : 'plate unsized' });
    const size = svg('text', { class: 'scale', x: half - 4, y: half - 5, 'text-anchor': 'end', 'font-size': half * 0.07 });
    size.textContent = side ? `${Math.round(side * 10) / 10} mm` : 'lines every 50 mm';
    this.grid.replaceChildren(plate, ...lines, size);
    this.layOut(this.layout);
  }

  remember(job, positions, at) {
    const last = this.past.at(-1);
    if (last && (last.job !== job || last.positions.length !== positions.length || at < last.at)) this.past = [];
    if (!last || at - last.at >= LEAST_STEP_S) this.past.push({ job, positions, at });
    this.past = this.past.filter((seen) => at - seen.at <= TRAIL_S);
  }

  /** Each part's trail in its own colour, the older the fainter. */
  drawTrails(at) {
    const lines = new Map();
    for (let i = 1; i < this.past.length; i += 1) {
      const [from, to] = [this.past[i - 1], this.past[i]];
      const band = Math.min(Math.floor(((at - to.at) / TRAIL_S) * BANDS), BANDS - 1);
      to.positions.forEach(([x, y], part) => {
        const [x0, y0] = from.positions[part];
        const way = Math.hypot(x - x0, y - y0);
        if (way <= 0.05 || way >= JUMP_MM) return;
        const style = `trail trail-${band} ${this.colourOf(part)}`;
        lines.set(style, `${lines.get(style) ?? ''}M${point([x0, y0])}L${point([x, y])}`);
      });
    }
    while (this.trails.children.length > lines.size) this.trails.lastElementChild.remove();
    while (this.trails.children.length < lines.size) this.trails.append(svg('path'));
    [...lines].forEach(([style, d], i) => {
      this.trails.children[i].setAttribute('class', style);
      this.trails.children[i].setAttribute('d', d);
    });
  }

  drawTargets(positions, targets) {
    while (this.marks.length < targets.length) {
      this.marks.push(svg('path', { class: 'target', d: 'M-7 0H7M0 -7V7M4.5 0A4.5 4.5 0 1 1 -4.5 0A4.5 4.5 0 1 1 4.5 0' }));
    }
    this.marks.length = targets.length;
    setChildren(this.targets, this.marks);
    targets.forEach((target, i) => this.marks[i].setAttribute('transform', `translate(${point(target)})`));
    const pairs = positions.length === targets.length ? targets : [];
    this.ways.setAttribute('d', pairs.map((target, i) => `M${point(positions[i])}L${point(target)}`).join(''));
  }

  drawParts(positions, radii) {
    while (this.coins.length < positions.length) {
      const number = svg('text', { class: 'number', 'text-anchor': 'middle', dy: '0.35em' });
      number.textContent = String(this.coins.length + 1);
      this.coins.push(svg('g', {}, svg('circle'), number));
    }
    this.coins.length = positions.length;
    setChildren(this.parts, this.coins);
    positions.forEach((position, i) => {
      this.coins[i].setAttribute('class', `part ${this.colourOf(i)}`);
      this.coins[i].setAttribute('transform', `translate(${point(position)})`);
      const radius = radii[i] ?? RADIUS_MM;
      this.coins[i].firstChild.setAttribute('r', String(radius));
      this.coins[i].lastChild.setAttribute('font-size', String(radius));
    });
  }
}
