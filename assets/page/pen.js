// A pen: targets drawn on the plate become a job in the editor, which the daemon checks.

import { arrangeOf, inJobOrder, markOf } from './drawn.js';
import { button, el, setChildren, svg } from './dom.js';
import { colours } from './kinds.js';
import { inWords } from './words.js';

const GRID_MM = 1;
const STEP_MM = 5;
const CHECK_MS = 400;
const MARGIN_MM = 6;
const WAYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
const HINT = `Press to set a target, drag it, press it again to take it away; Ctrl Z undoes. By keys: arrows move, Shift moves
  by 1 mm, Enter sets, Delete takes away.`;
/** A press that goes no farther than this sets or takes away, mm. */
const DRAG_MM = 3;

export class Pen {
  /** `write(text)` takes the job's text; `check()` has it checked and gives its faults, or null without an answer. */
  constructor(root, { write, check, plate }) {
    this.write = write;
    this.askCheck = check;
    this.chosenPlate = plate;
    this.plates = [];
    this.targets = [];
    /** The drawings before this one, newest last. */
    this.past = [];
    this.faults = new Map();
    this.cursor = [0, 0];
    this.kind = el('select', { 'aria-label': 'Kind of the parts' });
    [this.ground, this.shapes, this.cross] = [svg('g'), svg('g'), svg('path', { class: 'cursor', d: 'M-6 0H6M0 -6V6' })];
    const hears = {
      pointerdown: (event) => this.press(event),
      pointermove: (event) => this.drag(event),
      pointerup: () => this.drop(),
      pointercancel: () => this.drop(),
      keydown: (event) => this.key(event),
    };
    const says = { role: 'application', 'aria-label': 'Plate to draw on', 'aria-describedby': 'pen-hint' };
    const looks = { class: 'view sheet-to-draw', tabindex: 0 };
    this.sheet = svg('svg', { ...looks, ...says, ...hears }, this.ground, this.shapes, this.cross);
    this.says = el('ol', { class: 'pen-faults', 'aria-label': 'Faults of the drawing', 'aria-live': 'polite' });
    const undo = button('Undo', () => this.undo());
    const bar = el('div', { class: 'pen-tools' }, el('label', {}, 'Kind ', this.kind), undo, button('Clear', () => this.put([])));
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
    this.sheet.setPointerCapture(event.pointerId);
    this.cursor = this.placeOf(event);
    const { cursor: from, hit: target, targets: before } = this;
    if (target) this.held = { from, target, before };
    else this.toggle();
  }

  placeOf(event) {
    const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(this.sheet.getScreenCTM().inverse());
    return this.onPlate([x, -y]);
  }

  /** A target follows the hand; the job is written once it is let go. */
  drag(event) {
    if (!this.held) return;
    const { from, target, before } = this.held;
    const at = this.placeOf(event);
    if (this.targets === before && Math.hypot(at[0] - from[0], at[1] - from[1]) < DRAG_MM) return;
    this.cursor = at;
    this.targets = before.map((other) => (other === target ? { ...target, at } : other));
    this.render();
  }

  drop() {
    if (!this.held) return;
    const [{ before }, { targets }] = [this.held, this];
    this.held = null;
    this.targets = before;
    if (targets === before) this.toggle();
    else this.put(targets);
  }

  key(event) {
    const way = WAYS[event.key];
    const undoes = event.key === 'z' && (event.ctrlKey || event.metaKey);
    const does = undoes ? () => this.undo() : { Enter: () => this.toggle(), Delete: () => this.hit && this.toggle() }[event.key];
    if (!this.plate || !(way || does) || (!undoes && (event.ctrlKey || event.metaKey)) || event.altKey) return;
    event.preventDefault();
    if (does) return does();
    const step = event.shiftKey ? GRID_MM : STEP_MM;
    this.cursor = this.onPlate(this.cursor.map((mm, axis) => mm + way[axis] * step));
    this.render();
  }

  /** The target at the cursor. */
  get hit() {
    const [x, y] = this.cursor;
    return this.targets.findLast(({ kind, at }) => Math.hypot(at[0] - x, at[1] - y) <= this.radiusOf(kind));
  }

  undo() {
    if (this.past.length) this.put(this.past.pop(), false);
  }

  /** Takes the target at the cursor away, or sets one there. */
  toggle() {
    const { hit, cursor } = this;
    if (hit) this.put(this.targets.filter((target) => target !== hit));
    else this.put([...this.targets, { kind: this.kind.value, at: cursor }]);
  }

  /** Writes the job anew and has it checked once the hand rests. */
  put(targets, isNew = true) {
    if (isNew) this.past.push(this.targets);
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
      el('li', {}, el('strong', {}, `Target ${i + 1}: `), inWords(`expected ${allowed}, found ${found}`));
    setChildren(this.says, [...this.faults].sort(([a], [b]) => a - b).map(line));
  }

  /** A target as the part that comes there; red where there is a fault. */
  shape({ kind, at: [x, y] }, index, colour) {
    const number = svg('text', { x, y: -y, 'text-anchor': 'middle', dy: '0.35em' }, String(index + 1));
    const kindOfMark = `mark-drawn ${colour} ${this.faults.has(index) ? 'faulty' : ''}`;
    return svg('g', { class: kindOfMark }, svg('circle', { cx: x, cy: -y, r: this.radiusOf(kind) }), number);
  }
}
