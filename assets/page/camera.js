// The camera's newest picture of a job, asked for again and again while it can be seen.

import { ofJob, send, whole } from './api.js';
import { STALE_S, moment, since, span } from './age.js';
import { el, inSight, setText, show } from './dom.js';

/** A new picture comes before the one shown is stale; the daemon makes no more than two a second. */
const PICTURE_MS = 700;

/** So near to what can be seen of the page, in px, there are pictures already. */
const NEAR_PX = 800;

const nap = (ms) => new Promise((done) => setTimeout(done, ms));

export class Camera {
  /** `kept` names the file under which a picture can be kept; left out, it cannot. */
  constructor(what, kept) {
    this.picture = el('img', { alt: what, hidden: true });
    this.says = el('figcaption');
    // leads to what is shown, not to the daemon: a link carries no token
    this.link = kept ? el('a', { download: kept, title: 'Keep this picture' }, this.picture) : null;
    this.root = el('figure', { class: 'camera' }, el('div', { class: 'camera-frame' }, this.link ?? this.picture), this.says);
    this.near = true;
    const noted = (seen) => {
      this.near = seen.at(-1).isIntersecting;
    };
    new IntersectionObserver(noted, { rootMargin: `${NEAR_PX}px` }).observe(this.root);
  }

  /** Shows the pictures of `job` until `off` is called, or until there is none and `isOver()`. */
  async watch(job, isOver) {
    this.off('Waiting for a picture');
    this.root.classList.remove('dark');
    const control = new AbortController();
    this.control = control;
    while (!control.signal.aborted) {
      await inSight();
      try {
        if (this.near) await this.poll(job, control.signal);
      } catch (error) {
        if (control.signal.aborted) return;
        if (this.picture.hidden) setText(this.says, error.message);
        // of a job that has ended there comes no other picture
        if (isOver()) return;
      }
      await nap(PICTURE_MS);
    }
  }

  async poll(job, signal) {
    const asked = moment();
    await send('GET', ofJob(job, '/frame.png'), { signal }, async (response) => {
      const ageS = Number(response.headers.get('Upm-Age-Ms')) / 1000;
      const picture = await whole(response.blob());
      if (signal.aborted) return;
      this.put(picture);
      this.seen = { asked, ageS };
    });
  }

  put(picture) {
    const before = this.picture.src;
    this.picture.src = URL.createObjectURL(picture);
    if (this.link) this.link.href = this.picture.src;
    if (before) URL.revokeObjectURL(before);
    show(this.picture, true);
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

  end() {
    this.control?.abort();
    if (this.picture.src) URL.revokeObjectURL(this.picture.src);
  }
}
