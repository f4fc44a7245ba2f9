// Jobs, newest first, a page at a time; one of them may be open.

import { hasToken, json, ofJob, send, whole } from './api.js';
import { clock, span } from './age.js';
import { el, setChildren, setText, show, twice } from './dom.js';
import { Watched } from './watch.js';

const ON_A_PAGE = 20;
const ENDED = ['completed', 'failed', 'cancelled', 'interrupted'];
const KEPT = ['whole', 'partial'];

class Row {
  constructor(job, list) {
    this.list = list;
    this.state = el('span', { class: 'state' });
    this.name = el('button', { type: 'button', class: 'link job-name', click: () => list.toggle(this.job.id) });
    this.plate = el('span', { class: 'on' });
    this.time = el('time');
    this.took = el('span', { class: 'took' });
    this.reason = el('span', { class: 'reason' });
    this.recording = el('a', { href: ofJob(job.id, '/recording'), download: '', click: (e) => this.download(e) }, 'Recording');
    this.cancel = twice('Cancel', 'Really?', () => list.cancel(this.job.id));
    this.remove = twice('Delete', 'Really?', () => list.remove(this.job.id));
    this.writing = el('span', { class: 'writing' });
    const actions = el('span', { class: 'row-actions' }, this.recording, this.writing, this.cancel, this.remove);
    const line = el('div', { class: 'row' });
    line.append(this.state, this.name, this.plate, this.time, this.took, this.reason, actions);
    this.root = el('li', {}, line);
    this.take(job);
  }

  take(job) {
    this.job = job;
    this.root.dataset.job = job.id;
    this.state.dataset.state = job.state;
    this.updateState();
    setText(this.name, job.name);
    setText(this.plate, job.standing ? `${job.plate}, standing job` : job.plate);
    this.time.dateTime = job.submitted_at;
    this.time.title = `submitted ${job.submitted_at}`;
    setText(this.time, clock(job.submitted_at));
    const ran = (new Date(job.finished_at) - new Date(job.started_at)) / 1000;
    setText(this.took, job.started_at && job.finished_at ? `ran ${span(ran)}` : '');
    const lost = job.recording === 'pruned' ? 'recording pruned' : job.recording === 'failed' ? 'recording failed' : '';
    setText(this.reason, [job.state === 'completed' ? '' : job.reason, lost].filter(Boolean).join(' · '));
    show(this.recording, KEPT.includes(job.recording));
    this.recording.setAttribute('aria-label', `Recording of ${job.name}`);
    show(this.remove, ENDED.includes(job.state));
    this.remove.setAttribute('aria-label', `Delete ${job.name}`);
    if (job.state !== 'running') this.runs({ progress: 0, recording_mb: null });
    show(this.cancel, !ENDED.includes(job.state));
    this.cancel.setAttribute('aria-label', `Cancel ${job.name}`);
    this.watched?.take(job);
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
      this.list.showStatus(error.message);
    }
    setText(this.recording, 'Recording');
  }

  /** Its plate tells how far it is more often than the list is asked for. */
  runs({ progress, recording_mb: mb = null }) {
    if (this.job.state === 'running' && !this.job.standing) setText(this.state, `running ${Math.floor(progress * 100)} %`);
    show(this.writing, mb !== null);
    setText(this.writing, mb === null ? '' : `recording, ${mb.toFixed(1)} MB`);
  }

  /** The state with the share that is done, or with its place among those that wait for its plate. */
  updateState() {
    const { id, state, standing, progress } = this.job;
    const turn = this.list.turns.get(id);
    if (state === 'running' && !standing) setText(this.state, `running ${Math.floor(progress * 100)} %`);
    else if (state === 'queued' && turn) setText(this.state, `queued, ${turn === 1 ? 'next' : `no. ${turn}`}`);
    else setText(this.state, state);
  }

  open(changed) {
    this.watched = new Watched(this.job, changed);
    this.root.append(this.watched.root);
    this.root.classList.add('open');
    this.name.setAttribute('aria-expanded', 'true');
  }

  close() {
    this.watched?.end();
    this.watched?.root.remove();
    this.watched = undefined;
    this.root.classList.remove('open');
    this.name.setAttribute('aria-expanded', 'false');
  }
}

export class Jobs {
  /** `changed()` is called as the open job's state changes. */
  constructor(section, changed) {
    const part = (id) => section.querySelector(`#${id}`);
    [this.only, this.says, this.list, this.newer, this.older, this.pageOf] =
      ['only', 'jobs-say', 'rows', 'newer', 'older', 'page-of'].map(part);
    this.changed = changed;
    this.cursors = [null];
    this.rows = new Map();
    /** Places of queued jobs among those that wait for their plate; 1 runs next. */
    this.turns = new Map();
    this.opened = null;
    this.turning = false;
    this.only.addEventListener('change', () => this.turn([null]));
    // until a page has come, its neighbours are not known
    this.newer.addEventListener('click', () => this.turning || this.turn(this.cursors.slice(0, -1)));
    this.older.addEventListener('click', () => this.turning || this.turn([...this.cursors, this.next]));
  }

  showStatus(text) {
    setText(this.says, text);
  }

  turn(cursors) {
    this.cursors = cursors.length ? cursors : [null];
    this.turning = true;
    this.refresh();
  }

  async refresh() {
    const query = new URLSearchParams({ limit: String(ON_A_PAGE) });
    if (this.only.value) query.set('state', this.only.value);
    const cursor = this.cursors.at(-1);
    if (cursor) query.set('cursor', cursor);
    const turn = (this.turnNumber = (this.turnNumber ?? 0) + 1);
    try {
      const page = await json('GET', `/v1/jobs?${query}`);
      if (turn !== this.turnNumber) return;
      this.render(page);
      await this.askOpen(page);
    } catch (error) {
      this.turning = false;
      this.showStatus(`This list may be old: ${error.message}`);
      this.list.classList.add('stale');
    }
  }

  render({ jobs, next }) {
    this.next = next;
    this.list.classList.remove('stale');
    this.showStatus(jobs.length ? '' : this.only.value ? `No job is ${this.only.value}` : 'No jobs yet');
    const rows = jobs.map((job) => this.rows.get(job.id) ?? new Row(job, this));
    rows.forEach((row, i) => row.take(jobs[i]));
    this.keepOpen(rows);
    this.turning = false;
    this.put(rows);
    show(this.newer.parentElement, this.cursors.length > 1 || next !== null);
    this.newer.disabled = this.cursors.length < 2;
    this.older.disabled = next === null;
    setText(this.pageOf, `page ${this.cursors.length}`);
  }

  /** An open job that the page does not hold any more stays where it stands, until the page is turned. */
  keepOpen(rows) {
    const open = this.rows.get(this.opened);
    if (!open || rows.includes(open)) return;
    if (this.turning) this.toggle(this.opened);
    else rows.splice([...this.rows.keys()].indexOf(this.opened), 0, open);
  }

  /** Asks for the open job itself where the page does not tell of it. */
  async askOpen({ jobs }) {
    const open = this.rows.get(this.opened);
    if (!open || jobs.some((job) => job.id === open.job.id)) return;
    try {
      open.take(await json('GET', ofJob(open.job.id)));
    } catch (error) {
      if (error.status !== 404) throw error;
      // it was deleted meanwhile
      if (this.opened === open.job.id) this.toggle(open.job.id);
      this.put([...this.rows.values()].filter((row) => row !== open));
    }
  }

  put(rows) {
    this.rows = new Map(rows.map((row) => [row.job.id, row]));
    setChildren(this.list, [...this.rows.values()].map((row) => row.root));
  }

  /** Opens a job, wherever in the list it is. */
  async open(id) {
    if (!this.rows.has(id)) {
      this.only.value = '';
      this.cursors = [null];
      await this.refresh();
    }
    if (!this.rows.has(id)) await this.bring(id);
    if (this.opened !== id) this.toggle(id);
    this.rows.get(id)?.root.scrollIntoView({ block: 'nearest' });
    this.rows.get(id)?.name.focus();
  }

  /** A job of another page, put on top of this one. */
  async bring(id) {
    try {
      const row = new Row(await json('GET', ofJob(id)), this);
      this.put([row, ...this.rows.values()]);
    } catch (error) {
      this.showStatus(error.message);
    }
  }

  toggle(id) {
    const before = this.opened;
    this.rows.get(before)?.close();
    this.opened = before === id ? null : id;
    this.rows.get(this.opened)?.open(this.changed);
  }

  update(plates) {
    for (const plate of plates) if (plate.job) this.rows.get(plate.job)?.runs(plate);
  }

  /** The waiting jobs, in turn; `all` when there are no others. */
  wait(queued, all) {
    const ofPlate = new Map();
    this.turns.clear();
    for (const { id, plate } of all ? queued : []) {
      ofPlate.set(plate, (ofPlate.get(plate) ?? 0) + 1);
      this.turns.set(id, ofPlate.get(plate));
    }
    for (const row of this.rows.values()) if (row.job.state === 'queued') row.updateState();
  }

  async remove(id) {
    try {
      await send('DELETE', ofJob(id), {}, () => undefined);
      if (this.opened === id) this.toggle(id);
      this.showStatus('');
    } catch (error) {
      this.showStatus(error.message);
    }
    this.changed();
  }

  async cancel(id) {
    try {
      await json('POST', ofJob(id, '/cancel'));
      this.showStatus('');
    } catch (error) {
      this.showStatus(error.message);
    }
    this.changed();
  }

  tick() {
    this.rows.get(this.opened)?.watched?.tick();
  }
}
