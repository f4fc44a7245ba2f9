// A new job: a shipped example or a text of one's own, sent as it stands.

import { NoAnswer, Problem, json, newKey } from './api.js';
import { button, el, nap } from './dom.js';
import { Editor } from './editor.js';
import { withMember } from './places.js';

/** Sent again within this time after a success is a slip: a double click, a key held down. */
const AGAIN_MS = 1500;

/** Largest file that is read as a job; the daemon takes no larger ones. */
const MOST_BYTES = 1 << 20;

/** Members of a job that name files, with their values. */
function filesIn(job) {
  const isNamed = (name) => typeof job?.[name] === 'string' && job[name] !== '';
  return ['rig', 'library'].filter(isNamed).map((name) => ({ name, value: job[name] }));
}

export class Order {
  /** `queued(job)` is called with a job that was accepted. */
  constructor(form, queued) {
    this.queued = queued;
    const part = (id) => form.querySelector(`#${id}`);
    [this.example, this.plate, this.pace, this.button, this.file, this.says, this.edit] =
      ['example', 'order-plate', 'pace', 'order-send', 'job-file', 'order-says', 'edit'].map(part);
    this.editor = new Editor(part('editor'), () => this.edited());
    this.examples = [];
    this.names = [];
    this.key = { of: null, word: '' };
    this.example.addEventListener('change', () => this.take());
    this.plate.addEventListener('change', () => this.direct(this.plate.value));
    this.pace.addEventListener('change', () => this.forget());
    this.file.addEventListener('change', () => this.takeFile());
    part('order-check').addEventListener('click', () => this.check());
    form.addEventListener('submit', (event) => {
      event.preventDefault();
      this.send();
    });
    this.load();
  }

  async load() {
    try {
      this.examples = await json('GET', 'assets/examples.json');
      this.examples.sort((a, b) => a.name.localeCompare(b.name, 'en', { numeric: true }));
    } catch {
      setTimeout(() => this.load(), 2000);
      return;
    }
    const options = this.examples.map((example) => el('option', { value: example.name }, `${example.name}: ${example.what}`));
    this.example.replaceChildren(...options, el('option', { value: '' }, 'the text below, as edited'));
    if (this.editor.text === '') this.take();
    else this.example.value = '';
  }

  /** The plates there are. */
  offer(names) {
    if (names.join() === this.names.join()) return;
    this.names = names;
    const options = names.map((name) => el('option', { value: name }, name));
    this.plate.replaceChildren(el('option', { value: '' }, 'as the daemon chooses'), ...options);
    if (this.example.value) this.take();
    else this.follow();
  }

  /** Takes the chosen example, for the plate with the rig it was made for where there is one. */
  take() {
    const example = this.examples.find((example) => example.name === this.example.value);
    if (!example) return;
    const fits = this.names.find((name) => example.rig === name) ?? '';
    this.editor.text = withMember(example.text, 'plate', fits);
    this.forget();
    this.follow();
  }

  /** Takes a job file and has it checked. The files that it names stay behind: a plate has its rig and its library. */
  async takeFile() {
    const [file] = this.file.files;
    if (!file) return;
    // the same file may be chosen again once it is mended
    this.file.value = '';
    if (file.size > MOST_BYTES) return this.showStatus('bad', `Not taken: ${file.name} has more than 1 MiB.`);
    let text;
    try {
      text = await file.text();
    } catch {
      return this.showStatus('bad', `Not taken: ${file.name} cannot be read.`);
    }
    this.editor.text = text;
    const named = filesIn(this.editor.job());
    for (const member of named) text = withMember(text, member.name, '');
    this.write(text);
    this.edit.open = true;
    const left = named.map(({ name, value }) => `${name} ${value}`).join(' and ');
    await this.check(left && `Left out: ${left}; the plate has its own. `);
  }

  /** A text from elsewhere than the keyboard. */
  write(text) {
    this.editor.text = text;
    this.edited();
  }

  /** Has the daemon check the text as it stands; its faults, or null without an answer. */
  async check(before = '') {
    const text = this.editor.text;
    this.showStatus('', 'Checking');
    try {
      const { name, plate, layout } = await json('POST', 'v1/check', { body: text });
      // written on meanwhile: what is said is of another text
      if (this.editor.text !== text) return null;
      this.editor.blame([]);
      const parts = layout.parts.length === 1 ? '1 part' : `${layout.parts.length} parts`;
      this.showStatus('good', `${before}No fault: ${name} may be queued on ${plate}, with ${parts}.`);
      return [];
    } catch (error) {
      if (!(error instanceof Problem) && !(error instanceof NoAnswer)) throw error;
      if (this.editor.text !== text) return null;
      this.refused(error, `${before}Checked`);
      return error instanceof Problem ? error.faults : null;
    }
  }

  direct(plate) {
    this.editor.text = withMember(this.editor.text, 'plate', plate);
    this.forget();
    this.follow();
  }

  edited() {
    this.example.value = '';
    this.forget();
    this.follow();
  }

  /** The choice of plate shows what the text says. */
  follow() {
    const job = this.editor.job();
    if (job) this.plate.value = this.names.includes(job.plate) ? job.plate : '';
  }

  /** Removes the notes on an earlier text. */
  forget() {
    this.showStatus('', '');
  }

  showStatus(kind, ...parts) {
    this.says.className = `says ${kind}`;
    this.says.replaceChildren(...parts);
  }

  async send() {
    const [text, pace] = [this.editor.text, this.pace.value];
    const what = `${pace} ${text}`;
    if (this.button.ariaDisabled) return;
    this.button.ariaDisabled = 'true';
    if (this.key.of !== what) this.key = { of: what, word: newKey() };
    this.showStatus('', 'Sending');
    const asks = { body: text, headers: { 'Idempotency-Key': this.key.word }, timeoutMs: 15000 };
    try {
      const job = await json('POST', `v1/jobs?pace=${encodeURIComponent(pace)}`, asks);
      this.key.of = null;
      this.editor.blame([]);
      const open = button('show it', () => this.queued(job, true), { class: 'link' });
      this.showStatus('good', `Queued: ${job.name} on ${job.plate}. `, open);
      this.queued(job, false);
      await nap(AGAIN_MS);
    } catch (error) {
      this.refused(error);
    }
    this.button.ariaDisabled = null;
  }

  refused(error, what = 'Not queued') {
    if (error instanceof NoAnswer) {
      const unsure = 'No answer: it may or may not be queued. Send it again unchanged; it is queued once.';
      this.showStatus('bad', what === 'Not queued' ? unsure : 'No answer: it is not checked.');
      return;
    }
    if (!(error instanceof Problem)) throw error;
    // a fault of the daemon's own may have come after the job was taken: the same key again is safe
    if (error.status < 500) this.key.of = null;
    if (error.faults.length) this.edit.open = true;
    this.editor.blame(error.faults);
    const count = error.faults.length;
    const later = error.retryAfter ? ` Try again in ${error.retryAfter} s.` : '';
    const why = count ? `${count} ${count === 1 ? 'fault' : 'faults'}, listed by line.` : `${error.message}.${later}`;
    this.showStatus('bad', `${what}: ${why}`);
  }
}
