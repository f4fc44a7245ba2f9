// The card of one plate: what it looks like, how old that is, what it does, what waits, and what a person may do.

import { Problem, json, ofJob, ofPlate } from './api.js';
import { STALE_S, since, span } from './age.js';
import { Camera } from './camera.js';
import { announce, button, el, nap, setChildren, setText, show, twice } from './dom.js';
import { legend } from './kinds.js';
import { LastJob, newest } from './last.js';
import { ResetForm } from './reset.js';
import { View } from './view.js';
import { counted } from './words.js';

const QUEUE_SHOWN = 5;
/** Anything not known yet is asked for again after this. */
const AGAIN_MS = 300;
/** A plate that is less behind real time than this is not reported as behind, s. */
const LEAST_BEHIND_S = 0.1;

/** Largest odds that the daemon tells; higher ones are told as these. */
const MOST_ODDS = 1000;

const doubt = ({ odds, what }) => ` (${odds < MOST_ODDS ? '' : 'more than '}${odds}:1 over ${what})`;

/** Asks again and again until there is an answer; undefined once that `isOver()`, or where there is no such thing. */
async function until(ask, isOver) {
  while (!isOver()) {
    try {
      const found = await ask();
      if (found) return isOver() ? undefined : found;
    } catch (error) {
      if (error instanceof Problem && error.status === 404) return undefined;
    }
    await nap(AGAIN_MS);
  }
  return undefined;
}

export class PlateCard {
  /** `open(id)` shows a job; `stop(name)` stops the plate; `refresh()` asks for everything again. */
  constructor(name, { open, stop, refresh }) {
    this.name = name;
    this.open = open;
    this.refresh = refresh;
    this.plate = null;
    this.waiting = new Map();
    this.view = new View(name);
    this.camera = new Camera(`Camera of ${name}`);
    this.reset = new ResetForm(name, refresh);
    this.build(stop);
  }

  build(stop) {
    const { name } = this;
    const text = (tag, kind, label) => el(tag, label ? { class: kind, 'aria-label': `${label} ${name}` } : { class: kind });
    [this.state, this.phase, this.share] = ['state', 'phase', 'share'].map((kind) => text('span', kind));
    [this.age, this.why, this.remedy, this.standing, this.facts] =
      ['age', 'plate-why', 'remedy', 'standing', 'facts'].map((kind) => text('p', kind));
    this.legend = text('ul', 'legend', 'Kinds on');
    this.findings = text('ul', 'findings', 'Findings on');
    this.queue = text('ol', 'queue');
    this.job = button('', () => this.open(this.plate.job), { class: 'link job-name' });
    this.bar = el('progress', { max: 1, 'aria-label': `Progress on ${name}` });
    this.barBox = el('div', { class: 'bar' }, this.bar, this.share);
    this.doing = el('div', { class: 'doing' }, this.job, this.phase, this.barBox);
    this.last = new LastJob((id) => this.open(id));
    this.says = el('p', { class: 'why', role: 'alert' });
    this.resume = button('Resume', () => this.ask(ofPlate(name, '/resume')), { class: 'go' });
    this.cancel = this.cancelOf(null);
    this.actions = el('div', { class: 'actions' }, this.resume, this.cancel);
    const stopOne = button('Stop', () => stop(name), { class: 'estop-one', 'aria-label': `Emergency stop: ${name}` });
    const title = el('div', { class: 'card-title' }, el('h2', {}, name), this.state);
    const head = el('div', { class: 'card-head' }, title, stopOne);
    const drawing = el('div', { class: 'drawing' }, this.view.root, this.age, this.legend);
    const sights = el('div', { class: 'sights' }, drawing, this.camera.root);
    const says = [this.says, this.standing, this.facts];
    const now = [this.why, this.remedy, this.findings, this.doing, this.last.root];
    const rest = [...now, this.reset.root, this.queue, this.actions, ...says];
    this.root = el('article', { class: 'card panel', 'aria-label': `Plate ${name}` }, head, sights, ...rest);
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
    // a job may have come and gone since
    const isOther = plate.job === null && plate.at_s !== before?.at_s;
    if (!before || plate.job !== before.job || isOther) this.meet(plate.job, before?.job);
    this.last.take(this.last.job, plate.why);
    show(this.doing, plate.job !== null);
    this.bar.value = plate.progress;
    setText(this.share, `${Math.floor(plate.progress * 100)} %`);
    setText(this.phase, plate.phase || 'getting ready');
    this.takeStanding(plate);
    this.takeCauses(plate);
    this.reset.show(plate.state === 'stopped');
    const startsStanding = plate.state === 'idle' && plate.standing_job?.state === 'paused';
    show(this.resume, plate.state === 'paused' || startsStanding);
    const waiting = plate.queued ? `: ${counted(plate.queued, 'job waits', 'jobs wait')}` : '';
    setText(this.resume, `${startsStanding ? 'Start standing job' : 'Resume'}${waiting}`);
    show(this.cancel, plate.job !== null && plate.state === 'running');
    show(this.actions, !this.resume.hidden || !this.cancel.hidden);
    const behind = plate.behind_s < LEAST_BEHIND_S ? '' : `${plate.behind_s.toFixed(1)} s behind real time · `;
    const misses = plate.job === null ? this.last.job?.report?.deadline_misses : plate.job_deadline_misses;
    const missed = misses === undefined ? '' : `${counted(misses || 'No', 'deadline', 'deadlines')} missed · `;
    setText(this.facts, `${missed}${behind}plate time ${plate.at_s.toFixed(1)} s`);
    this.tick();
  }

  /** Why the plate does nothing, what holds in its run, and what to do about either: all as the daemon has it. */
  takeCauses({ why, state, pause, findings = [] }) {
    show(this.why, why !== '' && state !== 'running');
    setText(this.why, why);
    const remedy = pause && !pause.remedy_in_why ? pause.remedy : '';
    show(this.remedy, remedy !== '');
    setText(this.remedy, `What to do: ${remedy}`);
    const text = JSON.stringify(findings);
    if (this.findings.dataset.shown === text) return;
    this.findings.dataset.shown = text;
    show(this.findings, findings.length > 0);
    const cause = ({ reason, runner_up: other }) => `${reason}${other ? doubt(other) : ''}`;
    const line = (found) => el('li', {}, el('strong', {}, cause(found)), ' ', el('span', {}, found.remedy));
    this.findings.replaceChildren(...findings.map(line));
    if (findings.length) announce(`${this.name}: ${cause(findings.at(-1))}`);
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

  /** Another job came on the plate: what was pressed was meant for the one before. */
  meet(job, before) {
    setText(this.job, 'job');
    this.last.take(null);
    if (job === null) return this.rest(before);
    this.learn(job);
    this.camera.watch(job, () => this.plate.job !== job);
    const cancel = this.cancelOf(job);
    this.cancel.replaceWith(cancel);
    this.cancel = cancel;
  }

  /** Asks for name, bins, kinds and paths of the job until they are known, or the job is another one. */
  async learn(job) {
    this.layOut(null);
    const ask = () => Promise.all([json('GET', ofJob(job)), json('GET', ofJob(job, '/layout'))]);
    const found = await until(ask, () => this.plate.job !== job);
    if (!found) return;
    setText(this.job, found[0].name);
    this.layOut(found[1]);
  }

  /** Shows the job that ended last: the one `seen` on the plate, otherwise the newest that the daemon has. */
  async rest(seen) {
    const { at_s: at } = this.plate;
    const isOver = () => this.plate.job !== null || this.plate.at_s !== at;
    const list = async () => (await json('GET', `v1/jobs?plate=${encodeURIComponent(this.name)}`)).jobs;
    const job = seen ?? newest((await until(list, isOver)) ?? [])?.id;
    // its end is told once it is on the disk
    const ask = async () => [await json('GET', ofJob(job))].find(({ finished_at: end }) => end);
    const last = job && (await until(ask, isOver));
    if (!last) return;
    this.last.take(last, this.plate.why);
    if (seen) announce(`${this.name}: ${last.name} is ${last.state}`);
    else this.camera.watch(job, () => true);
    this.camera.keep(last.name);
    // a short job may have ended before its layout came
    const layout = await json('GET', ofJob(job, '/layout')).catch(() => null);
    if (layout && !isOver()) this.layOut(layout);
  }

  layOut(layout) {
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
    const rests = this.plate.job === null;
    const old = unheard || (!rests && age !== null && age > STALE_S);
    this.root.classList.toggle('unheard', unheard);
    this.root.classList.toggle('stale', old);
    this.root.classList.toggle('unseen-yet', age === null || rests);
    this.root.classList.toggle('bare', rests && !this.plate.positions_mm.length);
    this.root.dataset.state = unheard ? 'unknown' : state;
    this.state.dataset.state = this.root.dataset.state;
    setText(this.state, unheard ? `unknown, was ${state}` : state);
    if (age === null) setText(this.age, unheard ? `Not live: nothing heard for ${span(silence)}` : 'Nothing seen yet');
    else if (old) setText(this.age, `Not live: seen ${span(age)} ago`);
    else if (rests) setText(this.age, `At rest: seen ${span(age)} ago`);
    else setText(this.age, `Live: seen ${span(age)} ago`);
  }

  /** The jobs that wait for the plate, first come first. Their order is known only when `jobs` are `all` of them. */
  wait(jobs, all) {
    const here = all ? jobs.filter((job) => job.plate === this.name) : [];
    const rows = here.slice(0, QUEUE_SHOWN).map((job) => this.waiting.get(job.id) ?? this.waits(job));
    this.waiting = new Map(rows.map((row) => [row.dataset.job, row]));
    const left = all ? here.length - rows.length : this.plate.queued;
    if (left > 0) rows.push(el('li', { class: 'more' }, all ? `and ${left} behind them` : `${left} in all`));
    setChildren(this.queue, rows);
    show(this.queue, rows.length > 0);
  }

  cancelOf(job) {
    const name = this.plate?.standing_job?.state === 'running' ? 'Pause standing job' : 'Cancel job';
    return twice(name, 'Press again to cancel', () => this.ask(ofJob(job, '/cancel')));
  }

  waits({ id, name }) {
    const next = { class: 'first', 'aria-label': `Run ${name} next` };
    return el(
      'li',
      { 'data-job': id },
      button(name, () => this.open(id), { class: 'link' }),
      button('Run next', () => this.ask(ofJob(id, '/run-next')), next),
      twice('Cancel', 'Really?', () => this.ask(ofJob(id, '/cancel')), `Cancel ${name}`),
    );
  }

  async ask(path) {
    setText(this.says, '');
    try {
      await json('POST', path);
    } catch (error) {
      setText(this.says, error.message);
    }
    this.refresh();
  }
}
