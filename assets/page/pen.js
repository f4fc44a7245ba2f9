// A pen: targets and bins drawn on the plate become a job in the editor, which the daemon checks.

import { arrangeOf, inJobOrder, markOf, sortOf } from './drawn.js';
import { el, setChildren, setText, show, svg } from './dom.js';
import { colours } from './kinds.js';

const GRID_MM = 1;
const STEP_MM = 5;
/** A rectangle with a shorter side than this, in mm, is a slip of the hand. */
const LEAST_BIN_MM = 10;
const CHECK_MS = 400;
const MARGIN_MM = 6;

const snapped = (mm) => Math.round(mm / GRID_MM) * GRID_MM;

export class Pen {
  /** `write(text)` takes the job's text; `check()` has it checked and gives its faults, or null without an answer. */
  constructor(root, { write, check, plate }) {
    this.root = root;
    this.write = write;
    this.askCheck = check;
    this.chosenPlate = plate;
    this.plates = [];
    this.targets = [];
    this.bins = [];
    this.faults = new Map();
    this.mode = 'target';
    this.cursor = [0, 0];
    this.build();
  }

  build() {
    const tool = (value, text) => {
      const input = el('input', { type: 'radio', name: 'pen-tool', value, change: () => this.choose(value) });
      return el('label', { class: 'tool' }, input, text);
    };
    const tools = [tool('target', 'Targets'), tool('bin', 'Bins'), tool('erase', 'Eraser')];
    tools[0].firstChild.checked = true;
    this.kind = el('select', { 'aria-label': 'Kind of the parts' });
    this.count = el('input', { type: 'number', min: '1', max: '64', value: '2', 'aria-label': 'Parts for the next bin' });
    this.countOf = el('label', {}, 'Parts for a bin ', this.count);
    const clear = el('button', { type: 'button', click: () => this.clear() }, 'Clear');
    this.sheet = svg('svg', { class: 'view sheet-to-draw', tabindex: 0, role: 'application', 'aria-describedby': 'pen-hint' });
    this.sheet.setAttribute('aria-label', 'Plate to draw on');
    [this.ground, this.shapes, this.draft, this.cross] = [svg('g'), svg('g'), svg('g'), svg('path', { class: 'cursor', d: 'M-6 0H6M0 -6V6' })];
    this.sheet.append(this.ground, this.shapes, this.draft, this.cross);
    const hint = 'Press to set a target, drag for a bin. By keys: arrows move, Shift moves by 1 mm, Enter sets a target or a corner.';
    this.says = el('ol', { class: 'pen-faults', 'aria-label': 'Faults of the drawing', 'aria-live': 'polite' });
    const bar = el('div', { class: 'pen-tools' }, ...tools, el('label', {}, 'Kind ', this.kind), this.countOf, clear);
    this.root.append(bar, this.sheet, this.says, el('p', { class: 'hint', id: 'pen-hint' }, hint));
    this.sheet.addEventListener('pointerdown', (event) => this.press(event));
    this.sheet.addEventListener('pointermove', (event) => this.move(event));
    this.sheet.addEventListener('pointerup', (event) => this.release(event));
    this.sheet.addEventListener('pointercancel', () => this.drop());
    this.sheet.addEventListener('keydown', (event) => this.key(event));
  }

  get tool() {
    return this.root.querySelector('input[name="pen-tool"]:checked').value;
  }

  /** Takes a tool in hand; with the other pen the other drawing is shown, and is the job. */
  choose(tool) {
    const before = this.mode;
    if (tool !== 'erase') this.mode = tool;
    if (this.mode !== before) this.changed();
    else this.render();
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
    const kinds = this.plate?.kinds ?? [];
    const before = this.kind.value;
    this.kind.replaceChildren(...kinds.map(({ kind }) => el('option', { value: kind }, kind)));
    if (kinds.some(({ kind }) => kind === before)) this.kind.value = before;
    this.render();
  }

  /** Where on the plate the pointer is, mm, x right and y up, never outside. */
  placeOf(event) {
    const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(this.sheet.getScreenCTM().inverse());
    const half = this.plate.side_mm / 2;
    return [x, -y].map((mm) => snapped(Math.min(Math.max(mm, -half), half)));
  }

  press(event) {
    if (!this.plate || event.button !== 0) return;
    this.sheet.setPointerCapture(event.pointerId);
    this.from = this.placeOf(event);
    this.cursor = this.from;
    if (this.tool === 'erase') this.erase(event.target);
    this.render();
  }

  move(event) {
    if (!this.from) return;
    this.cursor = this.placeOf(event);
    this.render();
  }

  release(event) {
    if (!this.from) return;
    this.cursor = this.placeOf(event);
    const from = this.from;
    this.drop();
    if (this.tool === 'target') this.addTarget(this.cursor);
    if (this.tool === 'bin') this.addBin(from, this.cursor);
  }

  drop() {
    this.from = undefined;
    this.render();
  }

  key(event) {
    const ways = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    const way = ways[event.key];
    if (!this.plate || (!way && event.key !== 'Enter') || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    const [half, step] = [this.plate.side_mm / 2, event.shiftKey ? GRID_MM : STEP_MM];
    if (way) this.cursor = this.cursor.map((mm, axis) => Math.min(Math.max(mm + way[axis] * step, -half), half));
    else if (this.tool === 'target') this.addTarget(this.cursor);
    else if (this.tool === 'erase') this.erase(this.near());
    else if (this.from) {
      this.addBin(this.from, this.cursor);
      this.from = undefined;
    } else this.from = this.cursor;
    this.render();
  }

  addTarget(at) {
    this.targets.push({ kind: this.kind.value, at: [...at] });
    this.changed();
  }

  addBin(from, to) {
    const [min, max] = [Math.min, Math.max].map((pick) => from.map((mm, axis) => pick(mm, to[axis])));
    if (Math.min(max[0] - min[0], max[1] - min[1]) < LEAST_BIN_MM) return;
    const count = Math.min(Math.max(Math.round(Number(this.count.value)) || 1, 1), 64);
    this.bins.push({ kind: this.kind.value, count, min, max });
    this.changed();
  }

  /** The mark under the cursor of the keys. */
  near() {
    const [x, y] = this.cursor;
    return [...this.shapes.children].findLast((shape) => {
      const { x: left, y: top, width, height } = shape.getBBox();
      return x >= left && x <= left + width && -y >= top && -y <= top + height;
    });
  }

  erase(element) {
    const mark = element?.closest?.('[data-mark]');
    if (!mark) return;
    const marks = this.marks();
    const gone = marks[Number(mark.dataset.mark)];
    this.targets = this.targets.filter((target) => target !== gone);
    this.bins = this.bins.filter((bin) => bin !== gone);
    this.changed();
  }

  clear() {
    if (this.mode === 'bin') this.bins = [];
    else this.targets = [];
    this.changed();
  }

  /** The drawn places and bins, in the order of the job. */
  marks() {
    return this.mode === 'bin' ? this.bins : inJobOrder(this.targets);
  }

  /** Writes the job anew and has it checked once the hand rests. */
  changed() {
    this.faults.clear();
    clearTimeout(this.timer);
    if (this.marks().length) {
      const { name } = this.plate;
      this.write(this.mode === 'bin' ? sortOf(this.bins, name) : arrangeOf(this.targets, name));
      this.timer = setTimeout(() => this.check(), CHECK_MS);
    }
    this.render();
  }

  async check() {
    const marks = this.marks();
    const faults = await this.askCheck();
    // drawn on meanwhile: another check is on its way
    if (faults === null || marks.some((mark, i) => mark !== this.marks()[i])) return;
    this.faults.clear();
    for (const fault of faults) {
      const index = markOf(fault.path);
      if (index !== null && index < marks.length && !this.faults.has(index)) this.faults.set(index, fault);
    }
    this.render();
  }

  render() {
    const { plate } = this;
    if (!plate) return;
    const half = plate.side_mm / 2;
    const edge = half + MARGIN_MM;
    this.sheet.setAttribute('viewBox', `${-edge} ${-edge} ${2 * edge} ${2 * edge}`);
    const axes = svg('path', { class: 'axis', d: `M0 ${-half}V${half}M${-half} 0H${half}` });
    this.ground.replaceChildren(svg('rect', { class: 'plate', x: -half, y: -half, width: 2 * half, height: 2 * half, rx: 3 }), axes);
    const marks = this.marks();
    const colour = colours(marks.map(({ kind }) => kind));
    this.shapes.replaceChildren(...marks.map((mark, i) => this.shape(mark, i, colour.get(mark.kind))));
    this.draft.replaceChildren(...(this.from && this.tool === 'bin' ? [rectangle(this.from, this.cursor, 'bin')] : []));
    this.cross.setAttribute('transform', `translate(${this.cursor[0]} ${-this.cursor[1]})`);
    show(this.countOf, this.tool === 'bin');
    const what = this.mode === 'bin' ? 'Bin' : 'Target';
    const line = ([i, { found, allowed }]) => el('li', {}, el('strong', {}, `${what} ${i + 1}: `), `expected ${allowed}, found ${found}`);
    setChildren(this.says, [...this.faults].sort(([a], [b]) => a - b).map(line));
  }

  /** A target as the part that comes there, or a bin; red where there is a fault, which it tells. */
  shape(mark, index, colour) {
    const fault = this.faults.get(index);
    const group = svg('g', { 'data-mark': index, class: `mark-drawn ${colour ?? ''} ${fault ? 'faulty' : ''}` });
    const number = svg('text', { class: 'bin-name', 'text-anchor': 'middle', dy: '0.35em' });
    if (mark.at) {
      const radius = this.plate.kinds.find(({ kind }) => kind === mark.kind)?.radius_mm ?? 10;
      group.append(svg('circle', { cx: mark.at[0], cy: -mark.at[1], r: radius }));
      [number.textContent] = [String(index + 1)];
      number.setAttribute('x', mark.at[0]);
      number.setAttribute('y', -mark.at[1]);
    } else {
      group.append(rectangle(mark.min, mark.max, `bin ${colour ?? ''}`));
      setText(number, `${index + 1}: ${mark.count} × ${mark.kind}`);
      number.setAttribute('x', (mark.min[0] + mark.max[0]) / 2);
      number.setAttribute('y', -(mark.min[1] + mark.max[1]) / 2);
    }
    group.append(number);
    if (fault) {
      const title = svg('title');
      title.textContent = `expected ${fault.allowed}, found ${fault.found}`;
      group.append(title);
    }
    return group;
  }
}

function rectangle([x0, y0], [x1, y1], kind) {
  const [x, y] = [Math.min(x0, x1), -Math.max(y0, y1)];
  return svg('rect', { class: kind, x, y, width: Math.abs(x1 - x0), height: Math.abs(y1 - y0), rx: 2 });
}
