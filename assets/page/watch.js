// One job in full: its figures and what happened. There is one stream of events, that of the open job.

import { button, el, setText } from './dom.js';
import { watch } from './events.js';
import { counted, inWords } from './words.js';

const LINES = 200;
const COUNTS = ['cycles', 'pulses', 'collisions', 'lost parts'];

export class Watched {
  /** `changed()` is called when the job's state did, `close()` when it is no longer to be watched, and
      `foresee(plate, ways)` with where the parts of a cycle without a pause were to go. */
  constructor(job, changed, close, foresee) {
    this.job = job;
    this.foresee = foresee;
    this.control = new AbortController();
    this.state = el('span', { class: 'state' });
    this.says = el('p', { class: 'why', role: 'status' });
    this.facts = el('dl', { class: 'report' });
    this.cycle = el('p', { class: 'cycle' });
    this.log = el('ol', { class: 'log', 'aria-label': 'What happened' });
    const closing = button('Close', close, { 'aria-label': `Close ${job.name}` });
    const head = el('div', { class: 'section-head' }, el('h2', {}, `${job.name} on ${job.plate}`), this.state, closing);
    const parts = [this.facts, this.cycle, this.says, this.log];
    this.root = el('article', { class: 'panel watched', tabindex: -1, 'aria-label': `Job ${job.name}` }, head, ...parts);
    this.take(job);
    const on = (kind, body) => this.accept(kind, body, changed);
    watch(job, this.control.signal, on, (text) => setText(this.says, text));
  }

  /** Takes the present state of the job. */
  take(job) {
    this.job = job;
    this.state.dataset.state = job.state;
    setText(this.state, job.state);
    const report = job.report ?? {};
    const number = (key, unit, digits = 2) =>
      typeof report[key] === 'number' ? `${report[key].toFixed(digits)}${unit}` : undefined;
    const rows = {
      id: job.id,
      seed: String(job.seed),
      pace: job.pace === 'max' ? 'as fast as it can' : 'real time',
      recording: job.recording,
      reason: inWords(job.reason) || undefined,
      'what to do': todo(job, report.stop),
      guards: guards(report.guards),
      'worst error': number('max_error_mm', ' mm'),
      'RMS error': number('rms_error_mm', ' mm'),
      'off the path at most': number('cross_track_max_mm', ' mm'),
      'speed held': number('speed_held_mm_s', ` of ${report.speed_asked_mm_s} mm/s`, 1),
      'plate time': number('plate_time_s', ' s', 1),
      'wall time': number('wall_time_s', ' s', 1),
      'behind real time': report.behind_s > 0 ? number('behind_s', ' s', 1) : undefined,
      ...Object.fromEntries(COUNTS.map((what) => [what, number(what.replace(' ', '_'), '', 0)])),
    };
    const shown = Object.entries(rows).filter(([, value]) => value !== undefined);
    const text = JSON.stringify(shown);
    if (text === this.shown) return;
    this.shown = text;
    this.facts.replaceChildren(...shown.map(([name, value]) => el('div', {}, el('dt', {}, name), el('dd', {}, value))));
  }

  /** Takes the job, or a line of its journal. */
  accept(kind, body, changed) {
    if (kind === 'job') {
      if (body.state !== this.noted) this.note(null, body.state, `${body.state}${and(body.reason)}`);
      this.noted = body.state;
      this.take(body);
      if (body.finished_at !== null) this.foresee(body.plate, []);
      changed();
    } else if (body.type === 'cycle') this.hearCycle(body);
    else if (body.type === 'event') this.note(body.at_s, body.level, body.text);
  }

  hearCycle({ cycle, observed_at_s: from, ended_at_s: at, observed_mm: observed, predicted_mm: predicted, plan, result_mm: result, wanted }) {
    const farthest = (places) => {
      const far = result.length === places.length ? result.map(([x, y], i) => Math.hypot(x - places[i][0], y - places[i][1])) : [];
      return far.length ? Math.max(...far) : null;
    };
    const [left, went] = [wanted.targets_mm, observed].map(farthest);
    const pulses = plan.pulses.length;
    const hertz = plan.pulses[0]?.base_hz;
    // replaced after about a period; after a pulse the plate comes to rest for longer
    const moves = (at - from) * hertz < 1.5;
    const speed = moves && went !== null ? `, ${(went * hertz).toFixed(0)} mm/s at most` : '';
    const how = moves ? 'without a pause' : counted(pulses, 'pulse', 'pulses');
    const worst = left === null ? '' : `, largest distance to target ${left.toFixed(2)} mm`;
    setText(this.cycle, `Cycle ${cycle} at ${at.toFixed(1)} s: ${how}${worst}${speed}`);
    this.foresee(this.job.plate, moves && predicted.length ? predicted.map((end, i) => [observed[i], end]) : []);
  }

  note(at, kind, text) {
    const time = el('span', { class: 'at' }, at === null ? '' : `${at.toFixed(1)} s`);
    this.log.append(el('li', { class: kind }, time, el('span', {}, text)));
    while (this.log.children.length > LINES) this.log.firstChild.remove();
    this.log.scrollTop = this.log.scrollHeight;
  }

  end() {
    this.foresee(this.job.plate, []);
    this.control.abort();
    this.root.remove();
  }
}

/** The remedy for the end of a job, where its reason does not name it already. */
const todo = (job, stop) => (stop?.remedy && !job.reason.includes(stop.remedy) ? stop.remedy : undefined);

const guards = (found = []) => found.map(({ at_s: at, text }) => `at ${at.toFixed(1)} s ${text}`).join(' · ') || undefined;

const and = (reason) => (reason ? `: ${reason}` : '');
