// The operator page: asks the daemon how things are, several times a second, and shows it with its age.

import { NoAnswer, Problem, json, useToken, whenAsked } from './api.js';
import { STALE_S, moment, since, span } from './age.js';
import { el, nap, setChildren, setText, show } from './dom.js';
import { Stops } from './estop.js';
import { Jobs } from './jobs.js';
import { Pen } from './pen.js';
import { PlateCard } from './plate.js';
import { Order } from './submit.js';

const PLATES_MS = 200;
const READY_MS = 3000;
const JOBS_MS = 10000;
/** So many waiting jobs are asked for; of more the order is not shown, as those that run next come last. */
const MOST_WAITING = 200;

const part = (id) => document.getElementById(id);

const cards = new Map();
let heard = null;
const began = moment();
let trouble = '';
let standing = '';
let askedForJobs = 0;

const stops = new Stops(part('estop'), part('stop-report'), () => [...cards.keys()]);
const jobs = new Jobs(part('jobs'), () => refreshJobs(), (plate, ways) => cards.get(plate)?.view.foresee(ways));
const order = new Order(part('order'), (job, open) => {
  refreshJobs();
  if (open) jobs.open(job.id);
});

const pen = new Pen(part('pen'), {
  write: (text) => order.write(text),
  check: () => order.check(),
  plate: () => order.plate.value,
});

function takePlates(plates, asked) {
  heard = asked;
  trouble = '';
  for (const plate of plates) {
    if (!cards.has(plate.name)) {
      const acts = { open: (id) => jobs.open(id), stop: (name) => stops.one(name), refresh: refreshJobs };
      cards.set(plate.name, new PlateCard(plate.name, acts));
    }
    cards.get(plate.name).take(plate, asked);
  }
  const names = plates.map((plate) => plate.name);
  [...cards.keys()].filter((name) => !names.includes(name)).forEach((name) => cards.delete(name));
  setChildren(part('cards'), plates.map((plate) => cards.get(plate.name).root));
  order.offer(names);
  if (part('draw').open) pen.offer(plates);
  setText(part('waiting'), standOf(plates));
  stops.update(plates);
  jobs.update(plates);
  const now = JSON.stringify(plates.map(({ state, job, queued }) => [state, job, queued]));
  if (now !== standing || performance.now() - askedForJobs > JOBS_MS) {
    standing = now;
    refreshJobs();
  }
}

/** One line on what the plates do and what waits for them. */
function standOf(plates) {
  const count = (state) => plates.filter((plate) => plate.state === state).length;
  const states = ['stopped', 'paused', 'running', 'idle'].filter(count).map((state) => `${count(state)} ${state}`);
  const waits = plates.filter(({ queued }) => queued).map(({ name, queued }) => `${queued} for ${name}`);
  return `Plates: ${states.join(', ')} · Queue: ${waits.join(', ') || 'no job waits'}`;
}

async function watchPlates() {
  for (;;) {
    const asked = moment();
    try {
      const { plates, stop_listen } = await json('GET', 'v1/plates', { timeoutMs: 3000 });
      stops.listener = stop_listen;
      takePlates(plates, asked);
      show(part('token'), false);
    } catch (error) {
      if (!(error instanceof Problem) && !(error instanceof NoAnswer)) throw error;
      trouble = error instanceof Problem ? `the daemon says: ${error.message}` : error.message;
    }
    await nap(trouble ? 500 : PLATES_MS);
  }
}

async function refreshJobs() {
  const asked = performance.now();
  askedForJobs = asked;
  jobs.refresh();
  try {
    const queued = await json('GET', `v1/jobs?state=queued&limit=${MOST_WAITING}`);
    if (asked !== askedForJobs) return;
    const inTurn = queued.jobs.reverse().sort((a, b) => a.turn - b.turn);
    cards.forEach((card) => card.wait(inTurn, queued.next === null));
  } catch {
    // the plates' own answers tell whether the daemon is there
  }
}

async function watchReadiness() {
  for (;;) {
    const failed = await json('GET', 'readyz').then(() => null, (error) => error);
    if (!failed || failed instanceof Problem) showReasons(failed?.message.split('; ') ?? []);
    await nap(READY_MS);
  }
}

function showReasons(reasons) {
  const box = part('banners');
  const text = reasons.join('\n');
  if (box.dataset.text === text) return;
  box.dataset.text = text;
  box.replaceChildren(...reasons.map((reason) => el('p', { class: 'banner warn' }, reason)));
}

/** Updates that need no answer: every age goes on. */
function tick() {
  cards.forEach((card) => card.tick());
  const silence = since(heard ?? began);
  const lost = silence > STALE_S;
  document.body.classList.toggle('lost', lost);
  const contact = part('contact');
  contact.className = lost ? 'contact lost' : heard ? 'contact' : 'contact asking';
  if (lost) setText(contact, `No news for ${span(silence)}${trouble ? `: ${trouble}` : ''}`);
  else setText(contact, heard ? 'The daemon answers' : 'Asking the daemon');
  const running = [...cards.values()].filter((card) => card.plate?.state === 'running').length;
  const title = lost ? 'no answer' : running ? `${running} running` : 'at rest';
  if (document.title !== `${title} · upm`) document.title = `${title} · upm`;
}

whenAsked((wasWrong) => {
  const first = part('token').hidden;
  show(part('token'), true);
  setText(part('token-why'), wasWrong ? 'The daemon does not take this token.' : '');
  if (first) part('token-text').focus();
});
part('token').addEventListener('submit', (event) => {
  event.preventDefault();
  useToken(part('token-text').value.trim());
  part('token-text').value = '';
  setText(part('token-why'), '');
});

setInterval(tick, 100);
watchPlates();
watchReadiness();
