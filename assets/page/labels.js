// Places for the numbers of parts beside them, off every coin, mm. Beside is above for y downwards, as it is drawn.

const WAYS = 16;
const STEPS_MM = [0, 4, 9, 15];
const GAP_MM = 1.5;
/** How bad one millimetre of overlap is with a coin, another number, a target, and the outside of the plate. */
const ON_COIN = 100;
const ON_NUMBER = 60;
const ON_TARGET = 4;
const OUTSIDE = 40;
/** How bad it is to jump to the other side of a part, and to be a millimetre away from it. */
const JUMP = 3;
const AWAY = 0.4;

/** Half the width and height of a number in letters of `size`. */
const halves = (index, size) => [0.36 * size * String(index + 1).length + 0.3, 0.6 * size];

const onCoin = ([x, y], [w, h], [cx, cy, r]) => {
  const apart = Math.hypot(Math.max(Math.abs(cx - x) - w, 0), Math.max(Math.abs(cy - y) - h, 0));
  return Math.max(r - apart, 0);
};

const onNumber = ([x, y], [w, h], { at: [ox, oy], half: [ow, oh] }) =>
  Math.max(Math.min(w + ow - Math.abs(x - ox), h + oh - Math.abs(y - oy)), 0);

/** Every place where a number of a part may be: the nearest first, from the upper right on. */
function* candidates([x, y, r], [w, h]) {
  for (const away of STEPS_MM) {
    for (let way = 0; way < WAYS; way += 1) {
      const angle = -Math.PI / 4 + (2 * Math.PI * way) / WAYS;
      const [cos, sin] = [Math.cos(angle), Math.sin(angle)];
      const reach = r + GAP_MM + away + Math.abs(cos) * w + Math.abs(sin) * h;
      yield { at: [x + reach * cos, y + reach * sin], way, away };
    }
  }
}

/**
 * The places of all numbers, each `{ at, way, half }`. `coins` are `[x, y, radius]`, `marks` are `[x, y, radius]` of targets,
 * `edge` is half the plate's side; `before` are the places of the last time, which are kept where they are as good.
 */
export function place(coins, marks, edge, size, before = []) {
  const placed = [];
  coins.forEach((coin, index) => {
    const half = halves(index, size);
    const outside = (at) => Math.max(...at.map((v, axis) => Math.abs(v) + half[axis] - edge), 0);
    const cost = ({ at, way, away }) => {
      const coinsMet = coins.reduce((sum, other) => sum + onCoin(at, half, other), 0);
      const numbersMet = placed.reduce((sum, other) => sum + onNumber(at, half, other), 0);
      const marksMet = marks.reduce((sum, mark) => sum + onCoin(at, half, mark), 0);
      const jump = before[index] && before[index].way !== way ? JUMP : 0;
      return ON_COIN * coinsMet + ON_NUMBER * numbersMet + ON_TARGET * marksMet + OUTSIDE * outside(at) + AWAY * away + jump;
    };
    let best = { cost: Number.POSITIVE_INFINITY };
    for (const candidate of candidates(coin, half)) {
      const worth = cost(candidate);
      if (worth < best.cost) best = { ...candidate, cost: worth };
    }
    placed.push({ at: best.at, way: best.way, half });
  });
  return placed;
}
