// The age of the shown data. It goes on counting while the daemon does not answer.

/** With more than this, in s, what is shown is no longer called live. */
export const STALE_S = 2;

/** A moment on both of the browser's clocks: one pauses while the machine sleeps, the other may be set. */
export const moment = () => ({ steady: performance.now(), wall: Date.now() });

/** Seconds since `then`, by the clock that says more. */
export const since = (then) => Math.max(performance.now() - then.steady, Date.now() - then.wall, 0) / 1000;

/** `3.4 s`, `45 s`, `12 min`; the unit stays on the line of its number. */
export function span(seconds) {
  if (!Number.isFinite(seconds)) return '–';
  if (seconds < 10) return `${seconds.toFixed(1)}\u00a0s`;
  if (seconds < 100) return `${Math.floor(seconds)}\u00a0s`;
  if (seconds < 6000) return `${Math.floor(seconds / 60)}\u00a0min`;
  if (seconds < 172800) return `${Math.floor(seconds / 3600)}\u00a0h`;
  return `${Math.floor(seconds / 86400)}\u00a0days`;
}

/** A time of day in this browser's zone, which is named; with the date when that is not today. */
export function clock(text) {
  const time = new Date(text);
  const hours = time.toLocaleTimeString('en', { hourCycle: 'h23', timeZoneName: 'short' });
  return time.toDateString() === new Date().toDateString() ? hours : `${time.toLocaleDateString('sv')} ${hours}`;
}
