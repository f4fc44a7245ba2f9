// Server-sent events read by fetch: an EventSource sends no token.

import { NoAnswer, Problem, ofJob, send } from './api.js';
import { inSight } from './dom.js';

const SHORTEST_PAUSE_MS = 500;
const LONGEST_PAUSE_MS = 5000;
/** After so long out of sight a tab holds no stream: the tabs of a browser share few connections. */
const HIDDEN_MS = 5000;

/** Reads one stream and calls `on(kind, body)`; `last.id` is that of the last event that had one and came whole. */
async function read(response, last, on) {
  const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
  let text = '';
  let event = { kind: 'message', data: [], id: last.id };
  for (;;) {
    const { value, done } = await reader.read();
    if (done) return;
    text += value;
    const lines = text.split('\n');
    text = lines.pop();
    for (const line of lines) {
      if (line === '') {
        if (event.data.length) on(event.kind, JSON.parse(event.data.join('\n')));
        last.id = event.id;
        event = { kind: 'message', data: [], id: last.id };
      } else if (line.startsWith('event: ')) event.kind = line.slice(7);
      else if (line.startsWith('data: ')) event.data.push(line.slice(6));
      else if (line.startsWith('id: ')) event.id = line.slice(4);
    }
  }
}

/** Does `work(signal)`, which is to end when `signal` ends or when the tab has been out of sight for a while. */
async function whileSeen(signal, work) {
  const control = new AbortController();
  const end = () => control.abort();
  let timer;
  const updateVisibility = () => {
    clearTimeout(timer);
    if (document.hidden) timer = setTimeout(end, HIDDEN_MS);
  };
  signal.addEventListener('abort', end);
  document.addEventListener('visibilitychange', updateVisibility);
  updateVisibility();
  try {
    await work(control.signal);
  } finally {
    clearTimeout(timer);
    signal.removeEventListener('abort', end);
    document.removeEventListener('visibilitychange', updateVisibility);
  }
}

/** Watches a job until it has ended or until `signal`; goes on after the last line seen when the stream breaks. */
export async function watch(job, signal, on, broken) {
  // of a run that may have gone on for days only what is new
  const last = { id: job.state === 'running' ? undefined : '0' };
  let over = false;
  let pause = SHORTEST_PAUSE_MS;
  const onEvent = (kind, body) => {
    pause = SHORTEST_PAUSE_MS;
    over ||= kind === 'job' && body.finished_at !== null;
    on(kind, body);
  };
  const take = (response) => {
    broken('');
    return read(response, last, onEvent);
  };
  while (!over && !signal.aborted) {
    try {
      const headers = last.id === undefined ? {} : { 'Last-Event-ID': last.id };
      await whileSeen(signal, (signal) => send('GET', ofJob(job.id, '/events'), { headers, signal }, take));
    } catch (error) {
      if (signal.aborted) return;
      if (error instanceof Problem && error.status === 404) return broken(error.message);
      broken(error instanceof Problem ? error.message : 'the stream of events broke off; trying again');
      if (!(error instanceof Problem) && !(error instanceof NoAnswer)) console.warn(error);
    }
    if (over) return;
    await new Promise((done) => setTimeout(done, pause));
    pause = Math.min(pause * 2, LONGEST_PAUSE_MS);
    await inSight();
  }
}
