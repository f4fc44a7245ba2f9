// The camera's newest picture of a job, asked for again and again while it can be seen.

import { ofJob, send, whole } from './api.js';
import { STALE_S, moment, since, span } from './age.js';
import { el, inSight, nap, setText, show } from './dom.js';

/** A new picture comes before the one shown is stale; the daemon makes no more than two a second. */
const PICTURE_MS = 700;

export class Camera {
  constructor(what) {
    this.picture = el('img', { alt: what, hidden: true });
    this.says = el('figcaption');
    this.root = el('figure', { class: 'camera' }, el('div', { class: 'camera-frame' }, this.picture), this.says);
  }

  /** Shows the pictures of `job` until `off` is called, or until there is none and `isOver()`. */
  async watch(job, isOver) {
    this.off('Waiting for a picture');
    this.root.classList.remove('dark');
    this.control = new AbortController();
    const { signal } = this.control;
    while (!signal.aborted) {
      await inSight();
      try {
        if (this.isNear()) await this.poll(job, signal);
      } catch (error) {
        if (signal.aborted) return;
        if (this.picture.hidden) setText(this.says, error.message);
        // of a job that has ended there comes no other picture
        if (isOver()) return;
      }
      await nap(PICTURE_MS);
    }
  }

  /** True within a screen of what can be seen of the page. */
  isNear() {
    const { top, bottom } = this.root.getBoundingClientRect();
    return bottom > -innerHeight && top < 2 * innerHeight;
  }

  async poll(job, signal) {
    const asked = moment();
    await send('GET', ofJob(job, '/frame.png'), { signal }, async (response) => {
      const ageS = Number(response.headers.get('Upm-Age-Ms')) / 1000;
      const picture = await whole(response.blob());
      if (signal.aborted) return;
      URL.revokeObjectURL(this.picture.src);
      this.picture.src = URL.createObjectURL(picture);
      show(this.picture, true);
      this.seen = { asked, ageS };
    });
  }

  /** Shows no picture any more, and `why`. */
  off(why) {
    this.control?.abort();
    show(this.picture, false);
    this.root.classList.add('dark');
    setText(this.says, why);
  }

  /** The age goes on whether or not there comes a picture. */
  tick() {
    if (this.picture.hidden || !this.seen) return;
    const age = this.seen.ageS + since(this.seen.asked);
    this.picture.classList.toggle('stale', age > STALE_S);
    setText(this.says, `Seen ${span(age)} ago`);
  }
}
