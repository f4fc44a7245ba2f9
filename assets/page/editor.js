// The job's text with numbered lines, and faults beside the lines they are about.

import { el, setChildren } from './dom.js';
import { lineOf, places } from './places.js';

const GAP_PX = 6;

export class Editor {
  constructor(root, changed) {
    this.root = root;
    this.area = root.querySelector('textarea');
    this.gutter = root.querySelector('.gutter');
    this.marks = root.querySelector('.marks');
    this.notes = root.querySelector('.notes');
    this.faults = [];
    this.area.addEventListener('input', () => {
      this.render();
      changed();
    });
    this.area.addEventListener('scroll', () => this.scroll());
    new ResizeObserver(() => this.scroll()).observe(this.root);
    this.render();
  }

  get text() {
    return this.area.value;
  }

  set text(text) {
    this.area.value = text;
    this.render();
  }

  /** Shows faults, each beside its line, and the first of them in sight. */
  blame(faults) {
    const found = places(this.text);
    const placed = faults.map((fault) => [lineOf(this.text, fault, found), fault]);
    this.faults = placed.sort(([a], [b]) => a - b).map(([, fault]) => fault);
    this.render();
    const first = Math.min(...this.lines());
    if (Number.isFinite(first)) this.area.scrollTop = Math.max(0, (first - 4) * this.lineHeight());
    this.scroll();
  }

  lines() {
    if (!this.faults.length) return [];
    const found = places(this.text);
    return this.faults.map((fault) => lineOf(this.text, fault, found));
  }

  lineHeight() {
    return Number.parseFloat(getComputedStyle(this.area).lineHeight);
  }

  /** Numbers the lines and puts every fault to the line where its path is now. */
  render() {
    const count = this.text.split('\n').length;
    const lines = this.lines();
    const bad = new Set(lines);
    const numbers = Array.from({ length: count }, (_, i) => i + 1);
    const number = (n) => el('span', { class: bad.has(n) ? 'line bad' : 'line' }, String(n));
    const asIs = `${count} ${[...bad]}`;
    if (this.laid !== asIs) this.gutter.replaceChildren(...numbers.map(number));
    this.laid = asIs;
    this.marks.replaceChildren(...[...bad].map(() => el('div', { class: 'mark' })));
    this.marked = [...bad];
    setChildren(this.notes, this.faults.map((fault, i) => this.note(fault, lines[i])));
    this.notes.hidden = this.faults.length === 0;
    this.root.classList.toggle('faulty', this.faults.length > 0);
    this.area.setAttribute('aria-invalid', String(this.faults.length > 0));
    this.scroll();
  }

  note(fault, line) {
    fault.note ??= el(
      'li',
      { class: 'note' },
      el('button', { type: 'button', class: 'link line-of', click: () => this.goTo(fault) }),
      ' ',
      el('code', {}, fault.path),
      el('span', { class: 'expected' }, `expected: ${fault.allowed}`),
      el('span', { class: 'found' }, `found: ${fault.found}`),
    );
    fault.note.firstChild.textContent = `line ${line}`;
    fault.note.dataset.line = String(line);
    return fault.note;
  }

  goTo(fault) {
    const line = lineOf(this.text, fault);
    const start = this.text.split('\n').slice(0, line - 1).join('\n').length + (line > 1 ? 1 : 0);
    this.area.focus();
    this.area.setSelectionRange(start, start + (this.text.slice(start).split('\n')[0] ?? '').length);
  }

  /** Numbers, marks and notes follow the text. */
  scroll() {
    const height = this.lineHeight();
    const top = this.area.scrollTop;
    const padding = Number.parseFloat(getComputedStyle(this.area).paddingTop);
    const at = (line) => padding + (line - 1) * height - top;
    this.gutter.scrollTop = top;
    [...this.marks.children].forEach((mark, i) => {
      mark.style.transform = `translateY(${at(this.marked[i])}px)`;
    });
    let free = Number.NEGATIVE_INFINITY;
    const notes = this.faults.map((fault) => fault.note).sort((a, b) => a.dataset.line - b.dataset.line);
    for (const note of notes) {
      const y = Math.max(at(Number(note.dataset.line)), free);
      note.style.setProperty('--y', `${y}px`);
      free = y + note.offsetHeight + GAP_PX;
    }
  }
}
