// A new job: a shipped example or a text of one's own, sent as it stands.

import { NoAnswer, Problem, json, newKey } from './api.js';
import { button, el, nap } from './dom.js';
import { textOf } from './drawn.js';
import { Editor } from './editor.js';
import { counted, inWords } from './words.js';

/** Sent again within this time after a success is a slip: a double click, a key held down. */
const AGAIN_MS = 1500;

/** Largest file that is read as a job; the daemon takes no larger ones. */
const MOST_BYTES = 1 << 20;

/** Time between two questions how far dry runs are. */
const DRY_RUN_MS = 300;
const KINDS = { can_be_done: 'good', likely: 'good' };

/** A forecast in words. */
function foretold({ verdict, completed_of: [done, all], endings: [ending], plate_time_s: time, speed_mm_s: speed }) {
  const [least, middle, most, asked, held] = [...(time ?? [0, 0, 0]), ...(speed ?? [])].map((value) => value.toFixed(1));
  const says = [`Dry run: ${verdict.replaceAll('_', ' ')}, ${done} of ${all} reach the goal`];
  if (time) says.push(`about ${middle} s of plate time (${least} to ${most})`);
  if (speed) says.push(`paths at up to ${held} mm/s of ${asked} asked`);
  return [...says, ...(done < all ? [inWords(ending)] : [])].join('; ');
}

export class Order {
  /** `queued(job)` is called with a job that was accepted. */
  constructor(form, queued) {
    this.queued = queued;
    const part = (id) => form.querySelector(`#${id}`);
    [this.example, this.plate, this.pace, this.button, this.file, this.says, this.edit] =
      ['example', 'order-plate', 'pace', 'order-send', 'job-file', 'order-says', 'edit'].map(part);
    this.editor = new Editor(part('editor'), () => this.edited());
    [this.examples, this.names] = [[], []];
    this.key = { of: null, word: '' };
    this.example.addEventListener('change', () => this.take());
    this.plate.addEventListener('change', () => this.direct(this.plate.value));
    this.pace.addEventListener('change', () => this.follow());
    this.file.addEventListener('change', () => this.takeFile());
    part('order-check').addEventListener('click', () => this.check());
    part('order-dry').addEventListener('click', () => this.dryRun());
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
    this.editor.text = example.text;
    this.direct(this.names.find((name) => example.rig === name) ?? '');
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
    const job = this.editor.job();
    const named = ['rig', 'library'].filter((name) => typeof job?.[name] === 'string' && job[name] !== '');
    if (named.length) text = textOf(Object.fromEntries(Object.entries(job).filter(([name]) => !named.includes(name))));
    this.write(text);
    this.edit.open = true;
    const left = named.map((name) => `${name} ${job[name]}`).join(' and ');
    await this.check(left && `Left out: ${left}; the plate has its own. `);
  }

  /** A text from elsewhere than the keyboard. */
  write(text) {
    this.editor.text = text;
    this.edited();
  }

  /** The daemon's answer on the text as it stands; undefined where it refuses, which is told, null without one. */
  async ask(path, what) {
    const { text } = this.editor;
    try {
      const answer = await json('POST', path, { body: text });
      // written on meanwhile: what is said is of another text
      return this.editor.text === text ? answer : null;
    } catch (error) {
      if (this.editor.text === text) this.refused(error, what);
      return error instanceof Problem && this.editor.text === text ? undefined : null;
    }
  }

  /** Has the daemon check the text; its faults, or null without an answer. */
  async check(before = '') {
    this.showStatus('', 'Checking');
    const found = await this.ask('v1/check', `${before}Checked`);
    if (!found) return found === null ? null : this.editor.faults;
    const { name, plate, layout } = found;
    this.editor.blame([]);
    this.showStatus('good', `${before}No fault: ${name} may be queued on ${plate}, with ${counted(layout.parts.length, 'part', 'parts')}.`);
    return [];
  }

  /** Has the daemon make dry runs of the text, and tells what they predict. */
  async dryRun() {
    const turn = {};
    this.dry = turn;
    for (let share = 0; ; await nap(DRY_RUN_MS)) {
      this.showStatus('', `Dry runs: ${Math.floor(100 * share)} %`);
      const found = await this.ask('v1/dry-run', 'No dry run');
      if (!found || this.dry !== turn) return;
      this.editor.blame([]);
      if (found.forecast) return this.showStatus(KINDS[found.forecast.verdict] ?? 'bad', foretold(found.forecast));
      share = found.progress;
    }
  }

  /** The text goes to `plate`. */
  direct(plate) {
    const job = this.editor.job();
    if (job) this.editor.text = textOf({ ...job, plate: plate || undefined });
    this.follow();
  }

  edited() {
    this.example.value = '';
    this.follow();
  }

  /** The choice of plate shows what the text says; notes on an earlier text go. */
  follow() {
    this.showStatus('', '');
    const job = this.editor.job();
    if (job) this.plate.value = this.names.includes(job.plate) ? job.plate : '';
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
    this.dry = null;
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
    const unsure = 'No answer: it may or may not be queued. Send it again unchanged; it is queued once.';
    if (error instanceof NoAnswer) return this.showStatus('bad', what === 'Not queued' ? unsure : `${what}: no answer.`);
    if (!(error instanceof Problem)) throw error;
    // a fault of the daemon's own may have come after the job was taken: the same key again is safe
    if (error.status < 500) this.key.of = null;
    if (error.faults.length) this.edit.open = true;
    this.editor.blame(error.faults);
    const later = error.retryAfter ? ` Try again in ${error.retryAfter} s.` : '';
    const count = error.faults.length;
    const why = count ? `${counted(count, 'fault', 'faults')}, listed by line.` : `${error.message}.${later}`;
    this.showStatus('bad', `${what}: ${why}`);
  }
}
