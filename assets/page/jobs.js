// Jobs, newest first, a page at a time; above them the one that is open.

import { hasToken, json, ofJob, send, whole } from './api.js';
import { clock, span } from './age.js';
import { button, el, setChildren, setText, show, twice } from './dom.js';
import { Watched } from './watch.js';
import { inWords } from './words.js';

const ON_A_PAGE = 20;
const ENDED = ['completed', 'failed', 'cancelled', 'interrupted'];
const KEPT = ['whole', 'partial'];

class Row {
  constructor({ id, name, plate, standing, submitted_at: submitted }, list) {
    this.list = list;
    this.state = el('span', { class: 'state' });
    this.name = button(name, () => list.toggle(id), { class: 'link job-name' });
    this.time = el('time', { datetime: submitted, title: `submitted ${submitted}` });
    this.took = el('span', { class: 'took' });
    this.reason = el('span', { class: 'reason' });
    const asked = { href: ofJob(id, '/recording'), download: '', 'aria-label': `Recording of ${name}` };
    this.recording = el('a', { ...asked, click: (event) => this.download(event) }, 'Recording');
    this.cancel = twice('Cancel', 'Really?', () => list.ask('POST', ofJob(id, '/cancel')), `Cancel ${name}`);
    this.remove = twice('Delete', 'Really?', () => list.ask('DELETE', ofJob(id)), `Delete ${name}`);
    const actions = el('span', { class: 'row-actions' }, this.recording, this.cancel, this.remove);
    const on = el('span', { class: 'on' }, standing ? `${plate}, standing job` : plate);
    const line = [this.state, this.name, on, this.time, this.took, this.reason, actions];
    this.root = el('li', { class: 'row', 'data-job': id }, ...line);
  }

  take(job) {
    this.job = job;
    const { state, recording, reason } = job;
    this.state.dataset.state = state;
    setText(this.time, clock(job.submitted_at));
    const ran = (new Date(job.finished_at) - new Date(job.started_at)) / 1000;
    setText(this.took, job.started_at && job.finished_at ? `ran ${span(ran)}` : '');
    const lost = ['pruned', 'failed'].includes(recording) ? `recording ${recording}` : '';
    setText(this.reason, [state === 'completed' ? '' : inWords(reason), lost].filter(Boolean).join(' · '));
    show(this.recording, KEPT.includes(recording));
    show(this.remove, ENDED.includes(state));
    show(this.cancel, !ENDED.includes(state));
    this.showProgress(job.progress);
  }

  showProgress(progress) {
    const { state, standing } = this.job;
    setText(this.state, state === 'running' && !standing ? `running ${Math.floor(progress * 100)} %` : state);
  }

  /** With a token a plain link would be refused: the file is fetched and then saved. */
  async download(event) {
    if (!hasToken()) return;
    event.preventDefault();
    setText(this.recording, 'Fetching');
    try {
      const endless = { signal: new AbortController().signal };
      const take = (response) => whole(response.blob());
      const address = URL.createObjectURL(await send('GET', ofJob(this.job.id, '/recording'), endless, take));
      el('a', { href: address, download: `${this.job.name}.rrd` }).click();
      setTimeout(() => URL.revokeObjectURL(address), 60000);
    } catch (error) {
      setText(this.list.says, error.message);
    }
    setText(this.recording, 'Recording');
  }
}

export class Jobs {
  /** `changed()` is called as a job's state changes, `foresee(plate, ways)` as a watched one moves. */
  constructor(section, changed, foresee) {
    const part = (id) => section.querySelector(`#${id}`);
    [this.only, this.says, this.opened, this.list, this.newer, this.older, this.pageOf] =
      ['only', 'jobs-say', 'opened', 'rows', 'newer', 'older', 'page-of'].map(part);
    this.only.append(...['queued', 'running', ...ENDED].map((state) => el('option', { value: state }, state)));
    this.changed = changed;
    this.foresee = foresee;
    this.cursors = [null];
    this.rows = new Map();
    this.asked = 0;
    this.only.addEventListener('change', () => this.turn([null]));
    this.newer.addEventListener('click', () => this.turn(this.cursors.slice(0, -1)));
    this.older.addEventListener('click', () => this.turn([...this.cursors, this.next]));
  }

  turn(cursors) {
    this.cursors = cursors;
    // until the page has come, its neighbours are not known
    this.newer.disabled = true;
    this.older.disabled = true;
    this.refresh();
  }

  async refresh() {
    const query = new URLSearchParams({ limit: String(ON_A_PAGE) });
    if (this.only.value) query.set('state', this.only.value);
    const cursor = this.cursors.at(-1);
    if (cursor) query.set('cursor', cursor);
    this.asked += 1;
    const { asked } = this;
    try {
      const page = await json('GET', `v1/jobs?${query}`);
      if (asked === this.asked) this.render(page);
    } catch (error) {
      setText(this.says, `This list may be old: ${error.message}`);
      this.list.classList.add('stale');
    }
  }

  render({ jobs, next }) {
    this.next = next;
    this.list.classList.remove('stale');
    setText(this.says, jobs.length ? '' : this.only.value ? `No job is ${this.only.value}` : 'No jobs yet');
    this.rows = new Map(jobs.map((job) => [job.id, this.rows.get(job.id) ?? new Row(job, this)]));
    for (const job of jobs) {
      this.rows.get(job.id).take(job);
      if (job.id === this.watched?.job.id) this.watched.take(job);
    }
    setChildren(this.list, [...this.rows.values()].map((row) => row.root));
    this.markOpen();
    show(this.newer.parentElement, this.cursors.length > 1 || next !== null);
    this.newer.disabled = this.cursors.length < 2;
    this.older.disabled = next === null;
    setText(this.pageOf, `page ${this.cursors.length}`);
  }

  /** Opens a job, whether or not the list has it. */
  async open(id) {
    try {
      const job = await json('GET', ofJob(id));
      this.close();
      this.watched = new Watched(job, this.changed, () => this.close(), this.foresee);
      this.opened.replaceChildren(this.watched.root);
      this.watched.root.scrollIntoView({ block: 'nearest' });
      this.watched.root.focus({ preventScroll: true });
      this.markOpen();
    } catch (error) {
      setText(this.says, error.message);
    }
  }

  close() {
    this.watched?.end();
    this.watched = undefined;
    this.markOpen();
  }

  toggle(id) {
    if (this.watched?.job.id === id) this.close();
    else this.open(id);
  }

  markOpen() {
    for (const [id, row] of this.rows) row.name.setAttribute('aria-expanded', String(id === this.watched?.job.id));
  }

  update(plates) {
    // oftener than the list is asked for
    for (const plate of plates) if (plate.job) this.rows.get(plate.job)?.showProgress(plate.progress);
  }

  /** Cancels or deletes a job. */
  async ask(method, path) {
    try {
      await send(method, path, {}, () => undefined);
      if (method === 'DELETE' && path === ofJob(this.watched?.job.id)) this.close();
      setText(this.says, '');
    } catch (error) {
      setText(this.says, error.message);
    }
    this.changed();
  }
}
