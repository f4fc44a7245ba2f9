// Ending an emergency stop: who looked at the plate, and why it may move again. Starts nothing.

import { json, ofPlate } from './api.js';
import { el, setText, show } from './dom.js';

export class ResetForm {
  constructor(plate, done) {
    this.plate = plate;
    this.done = done;
    this.operator = this.field('Operator', 'operator', 200);
    this.reason = this.field('Why it may move again', 'reason', 1000);
    this.says = el('p', { class: 'why', role: 'alert' });
    const button = el('button', { type: 'submit' }, 'Reset the stop');
    const hint = el('p', { class: 'hint' }, 'Nothing starts by this: the plate is paused afterwards.');
    this.root = el('form', { class: 'reset', novalidate: true, hidden: true });
    this.root.append(this.operator.label, this.reason.label, button, this.says, hint);
    this.root.addEventListener('submit', (event) => {
      event.preventDefault();
      this.send();
    });
  }

  field(text, name, maxlength) {
    const input = el('input', { name, maxlength, autocomplete: 'off', required: true });
    const why = el('span', { class: 'why' });
    return { input, why, label: el('label', {}, text, input, why) };
  }

  show(shown) {
    if (shown === !this.root.hidden) return;
    show(this.root, shown);
    this.operator.input.value = '';
    this.reason.input.value = '';
    this.blame([]);
    setText(this.says, '');
  }

  blame(faults) {
    for (const field of [this.operator, this.reason]) {
      const fault = faults.find((fault) => fault.path === field.input.name);
      setText(field.why, fault ? fault.text : '');
      field.input.setAttribute('aria-invalid', String(fault !== undefined));
    }
  }

  missing() {
    const empty = [this.operator, this.reason].filter((field) => field.input.value.trim() === '');
    this.blame(empty.map((field) => ({ path: field.input.name, text: 'is needed' })));
    empty[0]?.input.focus();
    return empty.length > 0;
  }

  async send() {
    setText(this.says, '');
    if (this.missing()) return;
    const said = { operator: this.operator.input.value.trim(), reason: this.reason.input.value.trim() };
    try {
      await json('POST', ofPlate(this.plate, '/reset'), { body: JSON.stringify(said) });
    } catch (error) {
      const faults = error.faults ?? [];
      this.blame(faults.map((fault) => ({ path: fault.path, text: `expected ${fault.allowed}, found ${fault.found}` })));
      setText(this.says, faults.length ? '' : error.message);
    }
    this.done();
  }
}
