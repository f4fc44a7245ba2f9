// Requests to the daemon. The token, where one is asked for, lives in this tab and goes out in a header.

const KEPT = 'upm-token';
const TIMEOUT_MS = 5000;
let token = '';
let asked = () => {};

try {
  token = sessionStorage.getItem(KEPT) ?? '';
} catch {
  // a browser that keeps nothing: the token holds until the page is loaded again
}

/** Requests that an emergency stop may cut off, until their bodies end: a browser has few connections to one host. */
const others = new Set();
/** The tabs of a browser share those connections. */
const tabs = new BroadcastChannel('upm');

/** The daemon answered that it will not. */
export class Problem extends Error {
  constructor(status, body, retryAfter) {
    super(body.detail || body.title || `the daemon answered ${status}`);
    this.status = status;
    this.title = body.title ?? '';
    this.faults = Array.isArray(body.faults) ? body.faults : [];
    this.retryAfter = retryAfter;
  }
}

/** Nothing came back: whether the daemon did it is not known. */
export class NoAnswer extends Error {}

export function useToken(text) {
  token = text;
  try {
    sessionStorage.setItem(KEPT, text);
  } catch {
    // as above
  }
}

export const hasToken = () => token !== '';

/** `ask(wasWrong)` is called when the daemon wants a token. */
export function whenAsked(ask) {
  asked = ask;
}

/** Cuts off everything but emergency stops, in every tab, so that these get through at once. */
export function makeWay() {
  cutOthers();
  tabs.postMessage('make way');
}

function cutOthers() {
  for (const control of others) control.abort();
}

tabs.addEventListener('message', cutOthers);

/**
 * Sends a request and gives what `take` makes of the response. Throws `Problem`, `NoAnswer` or what `take` throws.
 * `timeoutMs` is the time until the answer begins, ms; `signal` ends the request, its body, too.
 */
export async function send(method, path, { timeoutMs = TIMEOUT_MS, signal, ...rest }, take) {
  const control = new AbortController();
  const stop = () => control.abort();
  if (!rest.urgent) others.add(control);
  let timer = setTimeout(stop, timeoutMs);
  try {
    const ends = signal ? AbortSignal.any([signal, control.signal]) : control.signal;
    const response = await answer(method, path, { ...rest, signal: ends });
    clearTimeout(timer);
    // bodies are short where no signal was given; they, too, must not take for ever
    if (!signal) timer = setTimeout(stop, rest.urgent ? 2000 : TIMEOUT_MS);
    return await take(response);
  } finally {
    clearTimeout(timer);
    // a body that `take` left unread would hold its connection
    stop();
    others.delete(control);
  }
}

async function answer(method, path, { body, headers: given, signal, urgent = false }) {
  const headers = { ...given };
  if (token) headers.Authorization = `Bearer ${token}`;
  if (body !== undefined) headers['Content-Type'] = 'application/json';
  const sentWith = token;
  const asks = { method, headers, body, signal, cache: 'no-store', redirect: 'error' };
  try {
    const response = await fetch(path, { ...asks, keepalive: urgent, priority: urgent ? 'high' : 'auto' });
    if (response.ok) return response;
    const problem = await response.json().catch(() => ({}));
    if (response.status === 401) asked(sentWith !== '' && sentWith === token);
    throw new Problem(response.status, problem, Number(response.headers.get('Retry-After')) || null);
  } catch (error) {
    if (error instanceof Problem) throw error;
    throw new NoAnswer('no answer from the daemon');
  }
}

/** A body once it has come in whole. */
export async function whole(body) {
  try {
    return await body;
  } catch {
    throw new NoAnswer('the answer broke off');
  }
}

export function json(method, path, options = {}) {
  return send(method, path, options, (response) => whole(response.json()));
}

/** A random key, unique for all practical purposes. */
export const newKey = () => crypto.getRandomValues(new Uint32Array(4)).join('-');

export const ofJob = (id, what = '') => `v1/jobs/${encodeURIComponent(id)}${what}`;
export const ofPlate = (name, what) => `v1/plates/${encodeURIComponent(name)}${what}`;
