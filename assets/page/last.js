// The job that ended last on a plate: how, when and how well. It stays on the card until the next one begins.

import { clock, span } from './age.js';
import { button, el, setText, show } from './dom.js';
import { inWords } from './words.js';

/** The job of these that ended last on its plate. */
export const newest = (jobs) =>
  jobs.filter((job) => job.started_at && job.finished_at).sort((a, b) => b.finished_at.localeCompare(a.finished_at))[0];

export class LastJob {
  /** `open(id)` shows a job. */
  constructor(open) {
    this.job = null;
    this.state = el('span', { class: 'state' });
    this.name = button('', () => open(this.job.id), { class: 'link job-name' });
    this.says = el('p', { class: 'hint' });
    this.root = el('div', { class: 'ended', hidden: true }, this.state, this.name, this.says);
  }

  /** Shows that job, or none; `told` is what the card says already. */
  take(job, told = '') {
    this.job = job;
    show(this.root, job !== null);
    if (!job) return;
    const { state, name, report, reason, started_at: from, finished_at: to } = job;
    this.state.dataset.state = state;
    setText(this.state, state);
    setText(this.name, name);
    const facts = [`ended ${clock(to)}`, `ran ${span((new Date(to) - new Date(from)) / 1000)}`];
    if (typeof report?.max_error_mm === 'number') facts.push(`worst error ${report.max_error_mm.toFixed(2)} mm`);
    if (!told.includes(reason)) facts.push(inWords(reason));
    setText(this.says, facts.join(' · '));
  }
}
