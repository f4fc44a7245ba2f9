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
    this.root = el('figure', { class: 'camera dark' }, el('div', { class: 'camera-frame' }, this.picture), this.says);
  }

  /** Shows the pictures of `job` until others are asked for, the last of them once `isOver()`. */
  async watch(job, isOver) {
    this.control?.abort();
    show(this.picture, false);
    setText(this.says, 'Waiting for a picture');
    this.kept = '';
    this.root.classList.remove('dark');
    this.control = new AbortController();
    const { signal } = this.control;
    while (!signal.aborted) {
      await inSight();
      const [{ top, bottom }, over] = [this.root.getBoundingClientRect(), isOver()];
      // within a screen of what can be seen of the page
      const isNear = bottom > -innerHeight && top < 2 * innerHeight;
      try {
        if (isNear) await this.poll(job, signal);
      } catch (error) {
        if (signal.aborted) return;
        if (this.picture.hidden) setText(this.says, error.message);
      }
      // of a job that has ended there comes no other picture
      if (isNear && over) return;
      await nap(PICTURE_MS);
    }
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

  /** The picture is from the end of the job `name` from now on. */
  keep(name) {
    this.kept = name;
    this.picture.classList.remove('stale');
  }

  /** The age goes on whether or not there comes a picture. */
  tick() {
    if (this.kept) {
      this.root.classList.toggle('dark', this.picture.hidden);
      return setText(this.says, `${this.picture.hidden ? 'No' : 'Last'} picture of ${this.kept}`);
    }
    if (this.picture.hidden || !this.seen) return;
    const age = this.seen.ageS + since(this.seen.asked);
    this.picture.classList.toggle('stale', age > STALE_S);
    setText(this.says, `Seen ${span(age)} ago`);
  }
}
