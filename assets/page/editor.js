// The job's text with numbered lines; faults are listed with the lines they are about, whose numbers are marked.

import { button, el } from './dom.js';
import { lineOf, places } from './places.js';
import { inWords } from './words.js';

export class Editor {
  constructor(root, changed) {
    this.root = root;
    this.area = root.querySelector('textarea');
    this.gutter = root.querySelector('.gutter');
    this.notes = root.querySelector('.notes');
    this.faults = [];
    this.area.addEventListener('input', () => {
      this.render();
      changed();
    });
    this.area.addEventListener('scroll', () => this.scroll());
    this.render();
  }

  get text() {
    return this.area.value;
  }

  set text(text) {
    this.area.value = text;
    this.blame([]);
  }

  /** The job, where its text can be read. */
  job() {
    try {
      return JSON.parse(this.text);
    } catch {
      return null;
    }
  }

  /** Shows faults in the order of their lines, and the first of these lines in sight. */
  blame(faults) {
    this.faults = faults;
    const [first] = this.render();
    if (first === undefined) return;
    this.area.scrollTop = (first - 4) * Number.parseFloat(getComputedStyle(this.area).lineHeight);
    this.scroll();
  }

  /** Numbers the lines and lists every fault with the line where its path is now; gives these lines. */
  render() {
    const { text } = this;
    const found = places(text);
    const job = this.job();
    const said = ({ path, allowed, found: is }) => ({ path: inWords(path, job), allowed: inWords(allowed, job), found: inWords(is, job) });
    const lined = this.faults.map((fault) => ({ ...said(fault), line: lineOf(text, fault, found) }));
    lined.sort((a, b) => a.line - b.line);
    const lines = lined.map(({ line }) => line);
    const number = (_, i) => el('span', { class: lines.includes(i + 1) ? 'line bad' : 'line' }, String(i + 1));
    this.gutter.replaceChildren(...text.split('\n').map(number));
    this.notes.replaceChildren(...lined.map((fault) => this.note(fault)));
    this.root.classList.toggle('faulty', lines.length > 0);
    this.area.setAttribute('aria-invalid', String(lines.length > 0));
    this.scroll();
    return lines;
  }

  note({ line, path, allowed, found }) {
    const says = [el('code', {}, path), el('span', {}, `expected: ${allowed}`), el('span', { class: 'found' }, `found: ${found}`)];
    const leads = button(`line ${line}`, () => this.goTo(line), { class: 'link' });
    return el('li', { class: 'note', 'data-line': line }, leads, ' ', ...says);
  }

  goTo(line) {
    const lines = this.text.split('\n');
    const start = lines.slice(0, line - 1).reduce((sum, { length }) => sum + length + 1, 0);
    this.area.focus();
    this.area.setSelectionRange(start, start + lines[line - 1].length);
  }

  scroll() {
    this.gutter.scrollTop = this.area.scrollTop;
  }
}
