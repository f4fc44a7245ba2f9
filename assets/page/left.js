// How much longer a job takes: the plate time that its progress so far leaves, in seconds of this clock.

/** With a smaller share done, or within so much plate time, in s, nothing is known. */
const LEAST_SHARE = 0.02;
const LEAST_PLATE_S = 2;
/** The pace of plate time is measured over the last samples, s, and is not known before the first of these. */
const LEAST_PACE_S = 1;
const PACE_S = 20;
/** Parts that go to their places come nearer ever more slowly; with this share of the way left they are there. */
const ARRIVED_SHARE = 0.005;

export class TimeLeft {
  constructor() {
    this.samples = [];
    this.forget();
  }

  forget() {
    this.samples = [];
    this.begin = { at: 0, share: 0 };
  }

  /**
   * Takes the state of a plate's job at `now`, in s of any steady clock; returns the seconds left, or null if unknown.
   * `settles` is true of a job whose parts go to places and end there.
   */
  take({ job, at_s: at, progress: share }, now, settles = false) {
    const last = this.samples.at(-1);
    if (last && (last.job !== job || at < last.at)) this.forget();
    this.samples.push({ job, at, now });
    while (this.samples.length > 2 && now - this.samples[0].now > PACE_S) this.samples.shift();
    // the way to the begin of the job proper tells nothing of its speed
    if (share < LEAST_SHARE) this.begin = { at, share };
    const ran = at - this.begin.at;
    const pace = this.pace();
    if (share < LEAST_SHARE || share >= 1 || ran < LEAST_PLATE_S || pace === null) return null;
    const open = (1 - share) / (1 - this.begin.share);
    const left = settles ? (ran * Math.log((1 - share) / ARRIVED_SHARE)) / -Math.log(open) : (ran * open) / (1 - open);
    return Math.max(left, 0) * pace;
  }

  /** Seconds of this clock in a second of plate time. */
  pace() {
    const [from, to] = [this.samples[0], this.samples.at(-1)];
    if (to.now - from.now < LEAST_PACE_S || to.at <= from.at) return null;
    return (to.now - from.now) / (to.at - from.at);
  }
}

/** `about 40 s left`, `about 3 min left`; nothing where `seconds` is null. */
export function about(seconds) {
  if (seconds === null) return '';
  if (seconds < 10) return 'about 10\u00a0s left';
  if (seconds < 90) return `about ${Math.round(seconds / 10) * 10}\u00a0s left`;
  if (seconds < 5400) return `about ${Math.round(seconds / 60)}\u00a0min left`;
  return `about ${Math.round(seconds / 3600)}\u00a0h left`;
}
