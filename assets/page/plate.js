// The card of one plate: what it looks like, how old that is, what it does, what waits, and what a person may do.

import { Problem, json, ofJob, ofPlate } from './api.js';
import { STALE_S, moment, since, span } from './age.js';
import { Camera } from './camera.js';
import { copy } from './device.js';
import { el, setChildren, setText, show, announce, twice } from './dom.js';
import { legend } from './kinds.js';
import { TimeLeft, about } from './left.js';
import { ResetForm } from './reset.js';
import { View } from './view.js';

const QUEUE_SHOWN = 5;
/** The layout of a job is asked for again after this while there is none yet. */
const LAYOUT_MS = 300;
/** For so long a missed deadline stands out, s. */
const LATE_S = 60;
/** A plate that is less behind real time than this is not reported as behind, s. */
const LEAST_BEHIND_S = 0.1;

export class PlateCard {
  /** `open(id)` shows a job; `stop(name)` stops the plate; `refresh()` asks for everything again. */
  constructor(name, { open, stop, refresh }) {
    this.name = name;
    this.open = open;
    this.refresh = refresh;
    this.plate = null;
    this.view = new View(name);
    this.timeLeft = new TimeLeft();
    this.build(stop);
  }

  build(stop) {
    this.state = el('span', { class: 'state' });
    this.stopButton = el('button', { type: 'button', class: 'estop-one', click: () => stop(this.name) }, 'Stop');
    this.stopButton.setAttribute('aria-label', `Emergency stop: ${this.name}`);
    this.age = el('p', { class: 'age' });
    this.why = el('p', { class: 'plate-why' });
    this.remedy = el('p', { class: 'remedy' });
    this.conditions = el('ul', { class: 'conditions', 'aria-label': `Conditions on ${this.name}` });
    this.job = el('button', { type: 'button', class: 'link job-name', click: () => this.open(this.plate.job) });
    this.phase = el('span', { class: 'phase' });
    this.bar = el('progress', { max: 1, 'aria-label': `Progress on ${this.name}` });
    this.share = el('span', { class: 'share' });
    this.left = el('span', { class: 'left' });
    this.barBox = el('div', { class: 'bar' }, this.bar, this.share, this.left);
    this.doing = el('div', { class: 'doing' }, this.job, this.phase, this.barBox);
    this.standing = el('p', { class: 'standing' });
    this.queue = el('ol', { class: 'queue' });
    this.facts = el('p', { class: 'facts' });
    this.liveLink = el('a');
    const copyLive = el('button', { type: 'button', click: () => copy(this.plate.live, copyLive, this.liveLink) }, 'Copy');
    this.live = el('p', { class: 'live', hidden: true }, 'Rerun: ', this.liveLink, ' ', copyLive);
    this.says = el('p', { class: 'why', role: 'alert' });
    this.resume = el('button', { type: 'button', class: 'go', click: () => this.act('resume') }, 'Resume');
    this.cancel = this.cancelOf(null);
    this.actions = el('div', { class: 'actions' }, this.resume, this.cancel);
    this.reset = new ResetForm(this.name, () => this.refresh());
    const title = el('div', { class: 'card-title' }, el('h2', {}, this.name), this.state);
    const head = el('div', { class: 'card-head' }, title, this.stopButton);
    this.legend = el('ul', { class: 'legend', 'aria-label': `Marks on ${this.name}` });
    this.camera = new Camera(`Camera of ${this.name}`);
    const drawing = el('div', { class: 'drawing' }, this.view.root, this.age, this.legend);
    const sights = el('div', { class: 'sights' }, drawing, this.camera.root);
    const says = [this.says, this.standing, this.facts, this.live];
    const rest = [this.why, this.remedy, this.conditions, this.doing, this.reset.root, this.queue, this.actions, ...says];
    this.root = el('article', { class: 'card', 'aria-label': `Plate ${this.name}` }, head, sights, ...rest);
  }

  /** Updates the card from a response to the request sent at `asked`. */
  take(plate, asked) {
    const before = this.plate;
    this.plate = plate;
    this.asked = asked;
    this.view.draw(plate, performance.now() / 1000);
    if (before && before.state !== plate.state) {
      announce(`${this.name} is ${plate.state}${plate.why ? `: ${plate.why}` : ''}`);
    }
    if (!before || plate.job !== before.job) this.meet(plate.job);
    show(this.doing, plate.job !== null);
    this.bar.value = plate.progress;
    setText(this.share, `${Math.floor(plate.progress * 100)} %`);
    setText(this.phase, plate.phase || 'getting ready');
    this.takeStanding(plate);
    this.takeCauses(plate);
    this.takeTimeLeft(plate);
    this.reset.show(plate.state === 'stopped');
    const startsStanding = plate.state === 'idle' && plate.standing_job?.state === 'paused';
    show(this.resume, plate.state === 'paused' || startsStanding);
    const waiting = plate.queued === 1 ? '1 job waits' : `${plate.queued} jobs wait`;
    const resumes = startsStanding ? 'Start standing job' : 'Resume';
    setText(this.resume, plate.queued ? `${resumes}: ${waiting}` : resumes);
    show(this.cancel, plate.job !== null && plate.state === 'running');
    show(this.actions, !this.resume.hidden || !this.cancel.hidden);
    const misses = plate.deadline_misses;
    const late = misses === 0 ? 'No deadline missed' : misses === 1 ? '1 deadline missed' : `${misses} deadlines missed`;
    const behind = plate.behind_s < LEAST_BEHIND_S ? '' : ` · ${plate.behind_s.toFixed(1)} s behind real time`;
    setText(this.facts, `${late}${behind} · plate time ${plate.at_s.toFixed(1)} s`);
    this.takeLive(plate.live);
    if (before && misses > before.deadline_misses) this.lateAt = moment();
    this.facts.classList.toggle('late', misses > 0 && this.lateAt !== undefined && since(this.lateAt) < LATE_S);
    this.tick();
  }

  /** Why the plate does nothing, what holds in its run, and what to do about either: all as the daemon has it. */
  takeCauses({ why, state, pause, conditions = [] }) {
    show(this.why, why !== '' && state !== 'running');
    setText(this.why, why);
    const remedy = pause && !pause.remedy_in_why ? pause.remedy : '';
    show(this.remedy, remedy !== '');
    setText(this.remedy, `What to do: ${remedy}`);
    const text = JSON.stringify(conditions);
    if (this.conditions.dataset.shown === text) return;
    this.conditions.dataset.shown = text;
    show(this.conditions, conditions.length > 0);
    const line = ({ reason, remedy: todo }) => el('li', {}, el('strong', {}, reason), ' ', el('span', {}, todo));
    this.conditions.replaceChildren(...conditions.map(line));
    if (conditions.length) announce(`${this.name}: ${conditions.at(-1).reason}`);
  }

  /** Hidden for jobs without an end. */
  takeTimeLeft(plate) {
    const seconds = this.timeLeft.take(plate, performance.now() / 1000, this.layout?.targets_mm.length > 0);
    const ends = plate.state === 'running' && this.layout?.endless === false;
    setText(this.left, ends ? about(seconds) : '');
  }

  takeLive(live) {
    show(this.live, live !== null);
    if (live === null || this.liveLink.textContent === live) return;
    setText(this.liveLink, live);
    this.liveLink.href = live;
  }

  /** The job that runs whenever nothing is queued. A run of it has no end to be measured against. */
  takeStanding({ standing_job: standing }) {
    show(this.barBox, standing?.state !== 'running');
    show(this.standing, standing !== null);
    if (standing === null) return;
    const why = standing.why ? `: ${standing.why}` : '';
    const turn = { running: 'runs until a job is queued', waiting: `waits${why}`, paused: `is paused${why}` };
    setText(this.standing, `Standing job ${standing.name} ${turn[standing.state]}`);
  }

  /** Another job came on the plate: its name is learned later, and what was pressed was meant for the one before. */
  meet(job) {
    setText(this.job, 'job');
    if (job === null) return this.camera.off('No picture: no job runs');
    this.learnLayout(job);
    this.camera.watch(job, () => this.plate.job !== job);
    const cancel = this.cancelOf(job);
    this.cancel.replaceWith(cancel);
    this.cancel = cancel;
  }

  /** Asks for bins, kinds and paths of the job until they are known, or the job is another one. */
  async learnLayout(job) {
    this.layOut(null);
    while (this.plate.job === job) {
      try {
        const layout = await json('GET', ofJob(job, '/layout'));
        if (this.plate.job === job) this.layOut(layout);
        return;
      } catch (error) {
        if (error instanceof Problem && error.status === 404) return;
      }
      await new Promise((done) => setTimeout(done, LAYOUT_MS));
    }
  }

  layOut(layout) {
    this.layout = layout;
    this.view.layOut(layout);
    this.legend.replaceChildren(...(layout ? legend(layout, this.view.colours) : []));
  }

  /** The age goes on whether or not the daemon answers. */
  tick() {
    if (!this.plate) return;
    this.camera.tick();
    const silence = since(this.asked);
    const unheard = silence > STALE_S;
    const { state, age_s: ageS } = this.plate;
    const age = ageS === null ? null : ageS + silence;
    const old = unheard || (age !== null && age > STALE_S);
    this.root.classList.toggle('unheard', unheard);
    this.root.classList.toggle('stale', old);
    this.root.classList.toggle('unseen-yet', age === null);
    this.root.dataset.state = unheard ? 'unknown' : state;
    setText(this.state, unheard ? `unknown, was ${state}` : state);
    if (age === null) setText(this.age, unheard ? `Not live: nothing heard for ${span(silence)}` : 'Nothing seen yet');
    else if (old) setText(this.age, `Not live: seen ${span(age)} ago`);
    else setText(this.age, `Live: seen ${span(age)} ago`);
  }

  /** The jobs that wait for the plate, first come first. Their order is known only when `jobs` are `all` of them. */
  wait(jobs, all) {
    const here = all ? jobs.filter((job) => job.plate === this.name) : [];
    const names = this.waiting ?? new Map();
    const rows = here.slice(0, QUEUE_SHOWN).map((job) => names.get(job.id) ?? this.waits(job));
    this.waiting = new Map(rows.map((row) => [row.dataset.job, row]));
    const left = all ? here.length - rows.length : this.plate.queued;
    if (left > 0) {
      this.rest ??= el('li', { class: 'more' });
      setText(this.rest, all ? `and ${left} behind them` : `${left} in all; too many wait to list them in turn`);
      rows.push(this.rest);
    }
    setChildren(this.queue, rows);
    show(this.queue, rows.length > 0);
  }

  /** Learns the name of the job that runs. */
  runs(job) {
    if (job.id === this.plate?.job) setText(this.job, job.name);
  }

  cancelOf(job) {
    const name = this.plate?.standing_job?.state === 'running' ? 'Pause standing job' : 'Cancel job';
    return twice(name, 'Press again to cancel', () => this.cancelJob(job));
  }

  waits(job) {
    const cancel = twice('Cancel', 'Really?', () => this.cancelJob(job.id));
    cancel.setAttribute('aria-label', `Cancel ${job.name}`);
    const name = el('button', { type: 'button', class: 'link', click: () => this.open(job.id) }, job.name);
    const first = el('button', { type: 'button', class: 'first', click: () => this.runNext(job.id) }, 'Run next');
    first.setAttribute('aria-label', `Run ${job.name} next`);
    const row = el('li', {}, name, first, cancel);
    row.dataset.job = job.id;
    return row;
  }

  async runNext(id) {
    await this.attempt(() => json('POST', ofJob(id, '/run-next')));
  }

  async cancelJob(id) {
    await this.attempt(() => json('POST', ofJob(id, '/cancel')));
  }

  async act(what) {
    await this.attempt(() => json('POST', ofPlate(this.name, `/${what}`)));
  }

  async attempt(ask) {
    setText(this.says, '');
    try {
      await ask();
    } catch (error) {
      setText(this.says, error.message);
    }
    this.refresh();
  }
}

