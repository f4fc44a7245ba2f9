// Kinds of parts: one colour for a kind wherever it is drawn, and what the drawing's marks mean.

import { el, svg } from './dom.js';

/** These have their colours in every job; others take what is left in the order of their names, as in recordings. */
const COINS = ['penny', 'nickel', 'dime', 'quarter'];
const COLOURS = 12;
const PX_PER_MM = 0.6;

/** The class that gives each of `kinds` its colour. */
export function colours(kinds) {
  const others = [...new Set(kinds)].filter((kind) => !COINS.includes(kind)).sort();
  const turn = (kind) => (COINS.includes(kind) ? COINS.indexOf(kind) : COINS.length + others.indexOf(kind));
  return new Map(kinds.map((kind) => [kind, `kind-${turn(kind) % COLOURS}`]));
}

/** The legend of a job's drawing: its kinds with their colours and sizes, and the other marks. */
export function legend({ parts, targets_mm: targets, bins, paths }, colour) {
  const kinds = new Map();
  for (const { kind, radius_mm: radius } of parts) {
    kinds.set(kind, { radius, count: (kinds.get(kind)?.count ?? 0) + 1 });
  }
  const coin = ([kind, { radius, count }]) =>
    entry(`${count} × ${kind}`, 2 * radius * PX_PER_MM, svg('circle', { r: radius, class: colour.get(kind) }));
  const marks = [];
  if (targets.length) marks.push(entry('target', 14, svg('path', { class: 'target-key', d: 'M-9 0H9M0 -9V9' })));
  if (bins.length) marks.push(entry('bin', 14, svg('rect', { class: 'bin', x: -9, y: -7, width: 18, height: 14, rx: 2 })));
  if (paths.length) marks.push(entry('path', 16, svg('path', { class: 'wanted', d: 'M-10 4C-4 -10 4 10 10 -4' })));
  return [...[...kinds].map(coin), ...marks];
}

/** `mark` is drawn about the origin, in mm. */
function entry(text, px, mark) {
  const half = px / PX_PER_MM / 2;
  const picture = svg('svg', { viewBox: `${-half} ${-half} ${2 * half} ${2 * half}`, width: px, height: px, 'aria-hidden': 'true' });
  picture.append(mark);
  return el('li', {}, picture, text);
}
