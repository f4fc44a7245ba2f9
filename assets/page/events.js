// Server-sent events read by fetch: an EventSource sends no token.

import { NoAnswer, Problem, ofJob, send } from './api.js';

const LONGEST_PAUSE_MS = 5000;

/** Reads one stream and calls `on(kind, body)`; gives the id of the last event that had one. */
async function read(response, last, on) {
  const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
  let text = '';
  let event = { kind: 'message', data: [] };
  for (;;) {
    const { value, done } = await reader.read();
    if (done) return;
    text += value;
    const lines = text.split('\n');
    text = lines.pop();
    for (const line of lines) {
      if (line === '') {
        if (event.data.length) on(event.kind, JSON.parse(event.data.join('\n')));
        event = { kind: 'message', data: [] };
      } else if (line.startsWith('event: ')) event.kind = line.slice(7);
      else if (line.startsWith('data: ')) event.data.push(line.slice(6));
      else if (line.startsWith('id: ')) last.id = line.slice(4);
    }
  }
}

/** Watches a job until its last event or until `signal`; goes on after the last event seen when the stream breaks. */
export async function watch(job, signal, on, broken) {
  const last = { id: '0' };
  let over = false;
  let pause = 500;
  while (!over && !signal.aborted) {
    try {
      const headers = { 'Last-Event-ID': last.id };
      const response = await send('GET', ofJob(job, '/events'), { headers, signal });
      broken('');
      await read(response, last, (kind, body) => {
        pause = 500;
        over ||= kind === 'finished' || (kind === 'bye' && body.why === 'the job is over');
        on(kind, body);
      });
    } catch (error) {
      if (signal.aborted) return;
      if (error instanceof Problem && error.status === 404) return broken(error.message);
      broken(error instanceof Problem ? error.message : 'the stream of events broke off; trying again');
      if (!(error instanceof Problem) && !(error instanceof NoAnswer)) console.warn(error);
    }
    if (over) return;
    await new Promise((done) => setTimeout(done, pause));
    pause = Math.min(pause * 2, LONGEST_PAUSE_MS);
  }
}
