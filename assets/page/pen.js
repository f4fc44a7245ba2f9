// A pen: targets drawn on the plate become a job in the editor, which the daemon checks.

import { arrangeOf, inJobOrder, markOf } from './drawn.js';
import { button, el, setChildren, svg } from './dom.js';
import { colours } from './kinds.js';

const GRID_MM = 1;
const STEP_MM = 5;
const CHECK_MS = 400;
const MARGIN_MM = 6;
const WAYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
const HINT = `Press to set a target, press it again to take it away. By keys: arrows move, Shift moves by 1 mm, Enter sets or
  takes away.`;

export class Pen {
  /** `write(text)` takes the job's text; `check()` has it checked and gives its faults, or null without an answer. */
  constructor(root, { write, check, plate }) {
    this.write = write;
    this.askCheck = check;
    this.chosenPlate = plate;
    this.plates = [];
    this.targets = [];
    this.faults = new Map();
    this.cursor = [0, 0];
    this.kind = el('select', { 'aria-label': 'Kind of the parts' });
    [this.ground, this.shapes, this.cross] = [svg('g'), svg('g'), svg('path', { class: 'cursor', d: 'M-6 0H6M0 -6V6' })];
    this.sheet = svg(
      'svg',
      {
        class: 'view sheet-to-draw',
        tabindex: 0,
        role: 'application',
        'aria-label': 'Plate to draw on',
        'aria-describedby': 'pen-hint',
        pointerdown: (event) => this.press(event),
        keydown: (event) => this.key(event),
      },
      this.ground,
      this.shapes,
      this.cross,
    );
    this.says = el('ol', { class: 'pen-faults', 'aria-label': 'Faults of the drawing', 'aria-live': 'polite' });
    const bar = el('div', { class: 'pen-tools' }, el('label', {}, 'Kind ', this.kind), button('Clear', () => this.put([])));
    root.append(bar, this.sheet, this.says, el('p', { class: 'hint', id: 'pen-hint' }, HINT));
  }

  get plate() {
    const chosen = this.chosenPlate();
    return this.plates.find(({ name }) => name === chosen) ?? this.plates[0];
  }

  /** The plates there are, with their sizes and kinds. */
  offer(plates) {
    const now = JSON.stringify([this.chosenPlate(), ...plates.map(({ name, side_mm, kinds }) => [name, side_mm, kinds])]);
    if (now === this.offered) return;
    this.offered = now;
    this.plates = plates;
    const { value } = this.kind;
    this.kind.replaceChildren(...this.plate.kinds.map(({ kind }) => el('option', { value: kind, selected: kind === value }, kind)));
    this.render();
  }

  /** The place on the plate that is nearest to `at`, mm. */
  onPlate(at) {
    const half = this.plate.side_mm / 2;
    return at.map((mm) => Math.round(Math.min(Math.max(mm, -half), half) / GRID_MM) * GRID_MM);
  }

  radiusOf(kind) {
    return this.plate.kinds.find((known) => known.kind === kind)?.radius_mm ?? 10;
  }

  press(event) {
    if (!this.plate || event.button !== 0) return;
    const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(this.sheet.getScreenCTM().inverse());
    this.cursor = this.onPlate([x, -y]);
    this.toggle();
  }

  key(event) {
    const way = WAYS[event.key];
    if (!this.plate || (!way && event.key !== 'Enter') || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    if (!way) return this.toggle();
    const step = event.shiftKey ? GRID_MM : STEP_MM;
    this.cursor = this.onPlate(this.cursor.map((mm, axis) => mm + way[axis] * step));
    this.render();
  }

  /** Takes the target at the cursor away, or sets one there. */
  toggle() {
    const [x, y] = this.cursor;
    const hit = this.targets.findLast(({ kind, at }) => Math.hypot(at[0] - x, at[1] - y) <= this.radiusOf(kind));
    if (hit) this.put(this.targets.filter((target) => target !== hit));
    else this.put([...this.targets, { kind: this.kind.value, at: [x, y] }]);
  }

  /** Writes the job anew and has it checked once the hand rests. */
  put(targets) {
    this.targets = inJobOrder(targets);
    this.faults.clear();
    clearTimeout(this.timer);
    if (targets.length) {
      this.write(arrangeOf(targets, this.plate.name));
      this.timer = setTimeout(() => this.check(), CHECK_MS);
    }
    this.render();
  }

  async check() {
    const { targets } = this;
    const faults = await this.askCheck();
    // drawn on meanwhile: another check is on its way
    if (faults === null || targets !== this.targets) return;
    const marked = faults.map((fault) => [markOf(fault.path), fault]).filter(([index]) => index !== null);
    this.faults = new Map(marked.reverse());
    this.render();
  }

  render() {
    if (!this.plate) return;
    const side = this.plate.side_mm;
    const edge = side / 2 + MARGIN_MM;
    this.sheet.setAttribute('viewBox', `${-edge} ${-edge} ${2 * edge} ${2 * edge}`);
    const outline = svg('rect', { class: 'plate', x: -side / 2, y: -side / 2, width: side, height: side, rx: 3 });
    const axes = svg('path', { class: 'axis', d: `M0 ${-side / 2}v${side}M${-side / 2} 0h${side}` });
    this.ground.replaceChildren(outline, axes);
    const colour = colours(this.targets.map(({ kind }) => kind));
    this.shapes.replaceChildren(...this.targets.map((target, i) => this.shape(target, i, colour.get(target.kind))));
    this.cross.setAttribute('transform', `translate(${this.cursor[0]} ${-this.cursor[1]})`);
    const line = ([i, { found, allowed }]) =>
      el('li', {}, el('strong', {}, `Target ${i + 1}: `), `expected ${allowed}, found ${found}`);
    setChildren(this.says, [...this.faults].sort(([a], [b]) => a - b).map(line));
  }

  /** A target as the part that comes there; red where there is a fault. */
  shape({ kind, at: [x, y] }, index, colour) {
    const number = svg('text', { x, y: -y, 'text-anchor': 'middle', dy: '0.35em' }, String(index + 1));
    const kindOfMark = `mark-drawn ${colour} ${this.faults.has(index) ? 'faulty' : ''}`;
    return svg('g', { class: kindOfMark }, svg('circle', { cx: x, cy: -y, r: this.radiusOf(kind) }), number);
  }
}
