// A pen: targets, start places and paths drawn on the plate become a job in the editor, which the daemon checks.

import { json } from './api.js';
import { inJobOrder, jobOf, madeBy, markOf, pathsOf, textOf } from './drawn.js';
import { button, el, setChildren, svg } from './dom.js';
import { colours } from './kinds.js';
import { inWords } from './words.js';

const GRID_MM = 1;
const STEP_MM = 5;
const CHECK_MS = 400;
const MARGIN_MM = 6;
const CORNER_MM = 6;
const WAYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
const USES = { target: 'targets', start: 'start places', path: 'paths' };
const NAMES = { target: 'Target', start: 'Start', path: 'Path' };
/** Rules for places, and a path that needs no corners. */
const SHAPES = { letters: 'letters', ring: 'a ring', grid: 'a grid', circle: 'a path in a circle' };
const HEARS = { pointerdown: 'press', pointermove: 'drag', pointerup: 'drop', pointercancel: 'drop', keydown: 'key' };
const HINT = `Press to set a target, a start place or a path's corner, drag it, press it again to take it away; Ctrl Z undoes. A
  part follows each path. By keys: arrows move, Shift moves by 1 mm, Enter sets, Delete takes away.`;
/** A press that goes no farther than this sets or takes away, mm. */
const DRAG_MM = 3;

const choice = (options) => el('select', {}, ...Object.entries(options).map(([value, text]) => el('option', { value }, text)));

export class Pen {
  /** `write(text)` takes the job's text; `check()` has it checked and gives its faults, or null without an answer. */
  constructor(root, { write, check, plate }) {
    Object.assign(this, { write, askCheck: check, chosenPlate: plate });
    [this.plates, this.faults, this.path, this.cursor] = [[], [], 1, [0, 0]];
    /** The drawing: use, kind, place, for a corner the number of its path, for a circle its radius. */
    this.marks = [];
    /** The drawings before this one, newest last. */
    this.past = [];
    [this.use, this.kind, this.shape] = [choice(USES), choice({}), choice(SHAPES)];
    const field = (value, more) => el('input', { value, ...more });
    this.text = field('UP', { maxlength: 32 });
    [this.count, this.size] = [14, 120].map((value) => field(value, { type: 'number', min: 1 }));
    [this.ground, this.shapes, this.cross] = [svg('g'), svg('g'), svg('path', { class: 'cursor', d: 'M-6 0H6M0 -6V6' })];
    const says = { role: 'application', 'aria-label': 'Plate to draw on', 'aria-describedby': 'pen-hint' };
    this.sheet = svg('svg', { class: 'view sheet-to-draw', tabindex: 0, ...says }, this.ground, this.shapes, this.cross);
    Object.entries(HEARS).forEach(([what, does]) => this.sheet.addEventListener(what, (event) => this[does](event)));
    this.says = el('ol', { class: 'pen-faults', 'aria-label': 'Faults of the drawing', 'aria-live': 'polite' });
    const bar = (fields, ...buttons) =>
      el('div', { class: 'pen-tools' }, ...Object.entries(fields).map(([name, input]) => el('label', {}, `${name} `, input)), ...buttons);
    const acts = [button('New path', () => (this.path += 1)), button('Undo', () => this.undo()), button('Clear', () => this.put([]))];
    const rule = { 'Or place': this.shape, Letters: this.text, Parts: this.count, 'Height in mm': this.size };
    const bars = [bar({ Draw: this.use, Kind: this.kind }, ...acts), bar(rule, button('Place', () => this.make()))];
    root.append(...bars, this.sheet, this.says, el('p', { class: 'hint', id: 'pen-hint' }, HINT));
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

  radiusOf({ use, kind }) {
    return use === 'path' ? CORNER_MM : (this.plate.kinds.find((known) => known.kind === kind)?.radius_mm ?? 10);
  }

  press(event) {
    if (!this.plate || event.button !== 0) return;
    this.sheet.setPointerCapture(event.pointerId);
    this.cursor = this.placeOf(event);
    const { cursor: from, hit: mark, marks: before } = this;
    if (mark) this.held = { from, mark, before };
    else this.toggle();
  }

  placeOf(event) {
    const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(this.sheet.getScreenCTM().inverse());
    return this.onPlate([x, -y]);
  }

  /** A mark follows the hand; the job is written once it is let go. */
  drag(event) {
    if (!this.held) return;
    const { from, mark, before } = this.held;
    const at = this.placeOf(event);
    if (this.marks === before && Math.hypot(at[0] - from[0], at[1] - from[1]) < DRAG_MM) return;
    this.cursor = at;
    this.marks = before.map((other) => (other === mark ? { ...mark, at } : other));
    this.render();
  }

  drop() {
    if (!this.held) return;
    const [{ before }, { marks }] = [this.held, this];
    this.held = null;
    this.marks = before;
    if (marks === before) this.toggle();
    else this.put(marks);
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

  /** The mark at the cursor, of those that are being drawn. */
  get hit() {
    const [x, y] = this.cursor;
    const isHit = (mark) => mark.use === this.use.value && Math.hypot(mark.at[0] - x, mark.at[1] - y) <= this.radiusOf(mark);
    return this.marks.findLast(isHit);
  }

  undo() {
    if (this.past.length) this.put(this.past.pop(), false);
  }

  /** Takes the mark at the cursor away, or sets one there. */
  toggle() {
    const { hit } = this;
    this.put(hit ? this.marks.filter((mark) => mark !== hit) : [...this.marks, this.mark(this.cursor)]);
  }

  /** A mark at `at`; a path is of the kind of its first corner. */
  mark(at, more) {
    const { path, marks } = this;
    const made = { use: this.use.value, kind: this.kind.value, at, path, ...more };
    return { ...made, kind: (made.use === 'path' && marks.find((other) => other.path === path)?.kind) || made.kind };
  }

  /** Places by a rule, as the daemon has them, to be dragged on; or a circle about the cursor to go round. */
  async make() {
    const [count, size] = [this.count, this.size].map(({ value }) => Number(value));
    const [use, shape] = [this.use.value === 'start' ? 'start' : 'target', this.shape.value];
    if (shape === 'circle') {
      this.path += 2;
      return this.put([...this.marks, this.mark(this.cursor, { use: 'path', path: this.path - 1, radius: size / 2 })]);
    }
    const job = madeBy(shape, { kind: this.kind.value, plate: this.plate.name, text: this.text.value, count, size });
    try {
      const { layout } = await json('POST', 'v1/check', { body: JSON.stringify(job) });
      const places = layout.targets_mm.map((at) => this.mark(at.map((mm) => Number(mm.toFixed(2))), { use }));
      this.put([...this.marks.filter((mark) => mark.use !== use), ...places]);
    } catch (error) {
      this.faults = error.faults?.length ? error.faults : [{ path: error.message }];
      this.render();
    }
  }

  /** Writes the job anew and has it checked once the hand rests. */
  put(marks, isNew = true) {
    if (isNew) this.past.push(this.marks);
    this.marks = inJobOrder(marks);
    this.faults = [];
    clearTimeout(this.timer);
    if (marks.length) {
      this.job = jobOf(this.marks, this.plate.name);
      this.write(textOf(this.job));
      this.timer = setTimeout(() => this.check(), CHECK_MS);
    }
    this.render();
  }

  async check() {
    const { marks } = this;
    const faults = await this.askCheck();
    // drawn on meanwhile: another check is on its way
    if (faults === null || marks !== this.marks) return;
    const placed = faults.map((fault) => ({ ...fault, mark: markOf(fault.path, this.job, marks) }));
    this.faults = placed.filter(({ mark }, i) => !mark || placed.findIndex((other) => other.mark === mark) === i);
    this.render();
  }

  render() {
    if (!this.plate) return;
    const side = this.plate.side_mm;
    const edge = side / 2 + MARGIN_MM;
    this.sheet.setAttribute('viewBox', `${-edge} ${-edge} ${2 * edge} ${2 * edge}`);
    const outline = svg('rect', { class: 'plate', x: -side / 2, y: -side / 2, width: side, height: side, rx: 3 });
    const axes = svg('path', { class: 'axis', d: `M0 ${-side / 2}v${side}M${-side / 2} 0h${side}` });
    this.ground.replaceChildren(outline, axes, ...pathsOf(this.marks).map((corners) => this.course(corners)));
    this.colour = colours(this.marks.map(({ kind }) => kind));
    this.shapes.replaceChildren(...this.marks.map((mark) => this.shapeOf(mark)));
    this.cross.setAttribute('transform', `translate(${this.cursor[0]} ${-this.cursor[1]})`);
    const about = ({ mark, path }) => (mark ? `${NAMES[mark.use]} ${this.numberOf(mark)}` : inWords(path, this.job));
    const says = ({ found, allowed }) => (allowed ? inWords(`: expected ${allowed}, found ${found}`, this.job) : '');
    setChildren(this.says, this.faults.map((fault) => el('li', {}, el('strong', {}, about(fault)), says(fault))));
  }

  numberOf({ use, path, at }) {
    if (use === 'path') return 1 + pathsOf(this.marks).findIndex(([first]) => first.path === path);
    return 1 + this.marks.filter((mark) => mark.use === use).findIndex((mark) => mark.at === at);
  }

  /** A closed path: a circle about its centre, or from corner to corner. */
  course([{ at: [x, y], radius }, ...more]) {
    if (radius) return svg('circle', { class: 'course', cx: x, cy: -y, r: radius });
    return svg('path', { class: 'course', d: `M${[[x, y], ...more.map(({ at }) => at)].map((at) => `${at[0]} ${-at[1]}`).join('L')}Z` });
  }

  /** A target or a start as the part there, a corner as a dot; red where there is a fault. */
  shapeOf(mark) {
    const [x, y] = mark.at;
    const name = `${mark.use === 'start' ? 'S' : ''}${this.numberOf(mark)}`;
    const number = svg('text', { x, y: -y, 'text-anchor': 'middle', dy: '0.35em' }, name);
    const faulty = this.faults.some((fault) => fault.mark === mark) ? 'faulty' : '';
    const circle = svg('circle', { cx: x, cy: -y, r: this.radiusOf(mark) });
    return svg('g', { class: `mark-drawn ${mark.use} ${this.colour.get(mark.kind)} ${faulty}` }, circle, number);
  }
}
