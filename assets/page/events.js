// Server-sent events read by fetch: an EventSource sends no token.

import { NoAnswer, Problem, ofJob, send } from './api.js';
import { inSight, nap } from './dom.js';

const SHORTEST_PAUSE_MS = 500;
const LONGEST_PAUSE_MS = 5000;

/** Reads one stream and calls `on(kind, body)`; `last.id` is that of the last event that had one and came whole. */
async function read(response, last, on) {
  const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
  let text = '';
  for (;;) {
    const { value, done } = await reader.read();
    if (done) return;
    const blocks = (text + value).split('\n\n');
    text = blocks.pop();
    for (const block of blocks) {
      const fields = Object.fromEntries(block.split('\n').map((line) => line.split(/: (.*)/s)));
      if (fields.data) on(fields.event ?? 'message', JSON.parse(fields.data));
      last.id = fields.id ?? last.id;
    }
  }
}

/** Aborts when the tab goes out of sight: then it holds no stream, as the tabs of a browser share few connections. */
function outOfSight() {
  const control = new AbortController();
  document.addEventListener('visibilitychange', () => control.abort(), { once: true });
  return control.signal;
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
      const ends = AbortSignal.any([signal, outOfSight()]);
      await send('GET', ofJob(job.id, '/events'), { headers, signal: ends }, take);
    } catch (error) {
      if (signal.aborted) return;
      if (error instanceof Problem && error.status === 404) return broken(error.message);
      broken(error instanceof Problem ? error.message : 'the stream of events broke off; trying again');
      if (!(error instanceof Problem) && !(error instanceof NoAnswer)) console.warn(error);
    }
    if (over) return;
    await nap(pause);
    pause = Math.min(pause * 2, LONGEST_PAUSE_MS);
    await inSight();
  }
}
