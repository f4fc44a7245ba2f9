// Ending an emergency stop: who looked at the plate, and why it may move again. Starts nothing.

import { json, ofPlate } from './api.js';
import { el, setText, show } from './dom.js';

export class ResetForm {
  constructor(plate, done) {
    this.says = el('p', { class: 'why', role: 'alert' });
    const field = (text, name, maxlength) =>
      el('label', {}, text, el('input', { name, maxlength, autocomplete: 'off', required: true }));
    this.root = el(
      'form',
      { class: 'reset', hidden: true },
      field('Operator', 'operator', 200),
      field('Why it may move again', 'reason', 1000),
      el('button', { type: 'submit' }, 'Reset the stop'),
      this.says,
      el('p', { class: 'hint' }, 'Nothing starts by this: the plate is paused afterwards.'),
    );
    this.root.addEventListener('submit', async (event) => {
      event.preventDefault();
      await this.send(plate);
      done();
    });
  }

  show(shown) {
    if (shown === !this.root.hidden) return;
    show(this.root, shown);
    this.root.reset();
    setText(this.says, '');
  }

  async send(plate) {
    setText(this.says, '');
    try {
      await json('POST', ofPlate(plate, '/reset'), { body: JSON.stringify(Object.fromEntries(new FormData(this.root))) });
    } catch (error) {
      const faults = (error.faults ?? []).map(({ path, allowed, found }) => `${path}: expected ${allowed}, found ${found}`);
      setText(this.says, faults.join('; ') || error.message);
    }
  }
}
