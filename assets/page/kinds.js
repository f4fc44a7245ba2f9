// Kinds of parts: one colour for a kind wherever it is drawn.

import { el } from './dom.js';

/** These have their colours in every job; others take what is left in the order of their names, as in recordings. */
const COINS = ['penny', 'nickel', 'dime', 'quarter'];
const COLOURS = 12;

/** The class that gives each of `kinds` its colour. */
export function colours(kinds) {
  const others = [...new Set(kinds)].filter((kind) => !COINS.includes(kind)).sort();
  const turn = (kind) => (COINS.includes(kind) ? COINS.indexOf(kind) : COINS.length + others.indexOf(kind));
  return new Map(kinds.map((kind) => [kind, `kind-${turn(kind) % COLOURS}`]));
}

/** The legend of a job's drawing: its kinds with their counts, in their colours. */
export function legend({ parts }, colour) {
  const kinds = parts.map(({ kind }) => kind);
  const count = (kind) => kinds.filter((other) => other === kind).length;
  return [...new Set(kinds)].map((kind) => el('li', { class: colour.get(kind) }, `${count(kind)} × ${kind}`));
}
