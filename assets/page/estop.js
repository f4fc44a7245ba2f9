// Emergency stop: every plate is asked at once, again and again until it has said that it stands. All together they are
// stopped by the listener beside the API, too, where there is one: whichever answers first.

import { NoAnswer, json, makeWay, ofPlate } from './api.js';
import { moment, since, span } from './age.js';
import { el, nap, setChildren, setText } from './dom.js';

/** A Mac's keys are ⌘ and ⌥; Ctrl and Alt do there, too. */
const IS_MAC = /mac|iphone|ipad/i.test(navigator.userAgentData?.platform ?? navigator.platform ?? '');
const TIMEOUT_MS = 2000;
const PAUSES_MS = [100, 200, 400, 800];

/** One plate that is being stopped. */
class Stopping {
  constructor(name) {
    this.name = name;
    this.tries = 0;
    this.began = moment();
    this.confirmed = false;
    this.ended = false;
    this.line = el('p', { class: 'trying' });
    this.showStatus('trying', 'stop is on its way');
  }

  showStatus(kind, text) {
    this.line.className = kind;
    setText(this.line, `${this.name}: ${text}`);
  }

  /** `listened` is a promise of what the listener answered for every plate, if it was asked. */
  async retryUntilConfirmed(listened) {
    while (!this.ended) {
      this.tries += 1;
      try {
        await this.accept(await this.answer(this.tries === 1 ? listened : null));
      } catch (error) {
        this.ended = error.status === 404;
        if (this.ended) return this.showStatus('loud', 'NOT STOPPED – the daemon knows no such plate');
        const why = error instanceof NoAnswer ? 'no answer' : error.message;
        this.showStatus('loud', `NOT CONFIRMED after ${span(since(this.began))} – ${why}; trying again (${this.tries})`);
        if (error instanceof NoAnswer) makeWay();
      }
      if (!this.ended) await pauseAfter(this.tries);
    }
  }

  /** The first answer of API and listener; without any, what the API's failure was. */
  answer(listened) {
    const asked = ask('POST', ofPlate(this.name, '/estop'));
    const ofListener = listened?.then((stops) => stops?.find((stop) => stop.plate === this.name) ?? asked);
    return Promise.any([asked, ofListener ?? asked]).catch((failed) => Promise.reject(failed.errors[0]));
  }

  async accept(answer) {
    if (!answer.silent && (await this.moves())) {
      this.showStatus('loud', `stop taken, motors NOT SEEN AT ZERO; asking again (${this.tries})`);
      return;
    }
    this.confirmed = true;
    this.ended = true;
    const motors = answer.silent ? 'motors silent' : 'nothing ran';
    if (answer.persisted) this.showStatus('done', `stopped, ${motors}`);
    else this.showStatus('loud', `stopped, ${motors}, but NOT YET ON THE DISK: a restart would forget it`);
  }

  /** Motors that were never asked for anything are not seen at zero: whether the plate has a job tells. */
  async moves() {
    const { plates } = await ask('GET', 'v1/plates');
    return plates.find((plate) => plate.name === this.name)?.job !== null;
  }
}

const ask = (method, path) => json(method, path, { urgent: true, timeoutMs: TIMEOUT_MS });

const isLoopback = (host) => /^(127\.|\[::1\]|localhost)/.test(host);
const pauseAfter = (tries) => nap(PAUSES_MS[Math.min(tries, PAUSES_MS.length) - 1]);

/** Stops every plate through the listener beside the API; null where it does not answer. */
async function askListener(listener) {
  const port = listener.slice(listener.lastIndexOf(':'));
  const host = listener.startsWith('0.0.0.0:') || listener.startsWith('[::]:') ? location.hostname + port : listener;
  // what listens there on the operator's machine is another program
  if (isLoopback(host) && !isLoopback(location.hostname)) return null;
  try {
    return (await json('POST', `http://${host}/v1/estop`, { urgent: true, timeoutMs: TIMEOUT_MS })).stops;
  } catch {
    return null;
  }
}

/** The stops that were asked for and what became of them. */
export class Stops {
  constructor(button, report, plateNames) {
    this.button = button;
    this.report = report;
    this.plateNames = plateNames;
    this.asked = new Map();
    this.searching = false;
    /** Address and port of the listener that stops every plate; null where there is none. */
    this.listener = null;
    this.unknown = el('p', { class: 'loud' });
    button.addEventListener('click', () => this.all());
    if (IS_MAC) this.nameKeysOfMac();
    window.addEventListener('keydown', (event) => this.key(event), { capture: true });
  }

  nameKeysOfMac() {
    const [control, alt] = document.querySelectorAll('#estop-keys kbd');
    [control.textContent, alt.textContent] = ['⌘', '⌥'];
    this.button.setAttribute('aria-keyshortcuts', 'Meta+Alt+S');
  }

  /** The keys of a stop, whatever has the focus and whatever the layout has on the key S. */
  key(event) {
    const areHeld = event.altKey && (event.ctrlKey || (IS_MAC && event.metaKey));
    const isS = event.code === 'KeyS' || event.key?.toLowerCase() === 's';
    // Windows takes Ctrl+Alt for AltGr: where that makes a letter of the key, neither Ctrl nor Alt is reported
    const isAltGr = event.code === 'KeyS' && event.getModifierState?.('AltGraph');
    if (!(areHeld && isS) && !isAltGr) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    if (!event.repeat) this.all();
  }

  all() {
    makeWay();
    const names = this.plateNames();
    if (names.length === 0) this.search();
    const listened = this.listener ? askListener(this.listener) : null;
    names.forEach((name) => this.begin(name, listened));
    this.render();
  }

  one(name) {
    makeWay();
    this.begin(name);
    this.render();
  }

  begin(name, listened = null) {
    const before = this.asked.get(name);
    if (before && !before.ended) return;
    const stopping = new Stopping(name);
    this.asked.set(name, stopping);
    stopping.retryUntilConfirmed(listened).then(() => this.render());
  }

  /** No plate is known yet: they are asked for until they are. */
  async search() {
    if (this.searching) return;
    this.searching = true;
    let why = 'no plate is known yet';
    for (let tries = 1; ; tries += 1) {
      setText(this.unknown, `NO PLATE STOPPED – ${why}; asking again (${tries})`);
      this.render();
      try {
        const answer = await ask('GET', 'v1/plates');
        this.searching = false;
        answer.plates.forEach((plate) => this.begin(plate.name));
        this.render();
        return;
      } catch (error) {
        why = error.message;
        await pauseAfter(tries);
      }
    }
  }

  /** A plate that was reset meanwhile needs no line any more. */
  update(plates) {
    for (const plate of plates) {
      const stopping = this.asked.get(plate.name);
      if (!stopping?.confirmed) continue;
      stopping.seen ||= plate.state === 'stopped';
      if (stopping.seen && plate.state !== 'stopped') this.asked.delete(plate.name);
    }
    this.render();
  }

  render() {
    const lines = [...this.asked.values()].map((stopping) => stopping.line);
    setChildren(this.report, this.searching ? [this.unknown, ...lines] : lines);
    const open = this.searching || [...this.asked.values()].some((stopping) => !stopping.ended);
    this.button.classList.toggle('trying', open);
  }
}
