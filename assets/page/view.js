// The plate from above, as the camera's table frame has it: origin at the centre, x right, y up, mm.

import { hold, svg } from './dom.js';

const TRAIL_S = 6;
const BANDS = 3;
const LEAST_STEP_S = 0.08;
/** A part that seems to go farther than this between two looks, in mm, was taken for another. */
const JUMP_MM = 25;
/** A penny's, where the daemon does not tell, mm. */
const RADIUS_MM = 9.525;
const MARGIN_MM = 8;

const fixed = (mm) => Number(mm.toFixed(2));

export class View {
  constructor(name) {
    this.name = name;
    this.grid = svg('g', { class: 'grid' });
    this.ways = svg('path', { class: 'ways' });
    this.trails = Array.from({ length: BANDS }, (_, i) => svg('path', { class: `trail trail-${i}` }));
    this.targets = svg('g');
    this.parts = svg('g');
    this.root = svg('svg', { class: 'view', role: 'img' });
    this.root.append(this.grid, this.ways, ...this.trails, this.targets, this.parts);
    this.marks = [];
    this.coins = [];
    this.past = [];
    this.half = 0;
  }

  /** Draws what was seen; `at` is when, in s of any steady clock. */
  draw({ job, positions_mm: positions, targets_mm: targets, side_mm: side, radii_mm: radii }, at) {
    this.frame(side, [...positions, ...targets]);
    this.remember(job, positions, at);
    this.drawTrails(at);
    this.drawTargets(positions, targets);
    this.drawParts(positions, radii ?? []);
    const count = (n, what) => `${n} ${what}${n === 1 ? '' : 's'}`;
    const label = `${this.name} from above: ${count(positions.length, 'part')}, ${count(targets.length, 'target')}`;
    if (this.root.getAttribute('aria-label') !== label) this.root.setAttribute('aria-label', label);
  }

  /** Outline and lines every 50 mm. A plate whose size is not told has no outline. */
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
  }

  remember(job, positions, at) {
    const last = this.past.at(-1);
    if (last && (last.job !== job || last.positions.length !== positions.length || at < last.at)) this.past = [];
    if (!last || at - last.at >= LEAST_STEP_S) this.past.push({ job, positions, at });
    this.past = this.past.filter((look) => at - look.at <= TRAIL_S);
  }

  drawTrails(at) {
    const lines = Array.from({ length: BANDS }, () => []);
    for (let i = 1; i < this.past.length; i += 1) {
      const [from, to] = [this.past[i - 1], this.past[i]];
      const band = Math.min(Math.floor(((at - to.at) / TRAIL_S) * BANDS), BANDS - 1);
      to.positions.forEach(([x, y], part) => {
        const [x0, y0] = from.positions[part];
        const way = Math.hypot(x - x0, y - y0);
        if (way > 0.05 && way < JUMP_MM) lines[band].push(`M${fixed(x0)} ${fixed(-y0)}L${fixed(x)} ${fixed(-y)}`);
      });
    }
    this.trails.forEach((trail, band) => trail.setAttribute('d', lines[band].join('')));
  }

  drawTargets(positions, targets) {
    while (this.marks.length < targets.length) {
      this.marks.push(svg('path', { class: 'target', d: 'M-7 0H7M0 -7V7M4.5 0A4.5 4.5 0 1 1 -4.5 0A4.5 4.5 0 1 1 4.5 0' }));
    }
    this.marks.length = targets.length;
    hold(this.targets, this.marks);
    targets.forEach(([x, y], i) => this.marks[i].setAttribute('transform', `translate(${fixed(x)} ${fixed(-y)})`));
    const pairs = positions.length === targets.length ? targets : [];
    const way = ([x, y], i) => `M${fixed(positions[i][0])} ${fixed(-positions[i][1])}L${fixed(x)} ${fixed(-y)}`;
    this.ways.setAttribute('d', pairs.map(way).join(''));
  }

  drawParts(positions, radii) {
    while (this.coins.length < positions.length) {
      const number = svg('text', { class: 'number', 'text-anchor': 'middle', dy: '0.35em' });
      number.textContent = String(this.coins.length + 1);
      this.coins.push(svg('g', { class: 'part' }, svg('circle', { r: RADIUS_MM }), number));
    }
    this.coins.length = positions.length;
    hold(this.parts, this.coins);
    positions.forEach(([x, y], i) => {
      this.coins[i].setAttribute('transform', `translate(${fixed(x)} ${fixed(-y)})`);
      this.coins[i].firstChild.setAttribute('r', String(radii[i] ?? RADIUS_MM));
    });
  }
}
