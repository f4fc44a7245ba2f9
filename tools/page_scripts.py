"""What `page_test.py` asks the browser about the page, as scripts that run in it."""

# Whatever else can be pressed within so many px of an element, where a finger would meet it.
CLEARANCE_JS = """([of, px]) => {
  const own = document.querySelector(of);
  const box = own.getBoundingClientRect();
  const met = new Set();
  for (let x = box.left - px; x <= box.right + px; x += 4) {
    for (let y = box.top - px; y <= box.bottom + px; y += 4) {
      const [dx, dy] = [Math.max(box.left - x, x - box.right, 0), Math.max(box.top - y, y - box.bottom, 0)];
      if (Math.hypot(dx, dy) > px) continue;
      const there = document.elementFromPoint(x, y)?.closest('button, a, input, select, textarea');
      if (there && there !== own) met.add(`${there.className || there.id || there.tagName}: ${there.textContent.slice(0, 20)}`);
    }
  }
  return [...met];
}"""

# Where the parts of a plate are drawn, mm.
PLACES_JS = """(plate) => [...document.querySelectorAll(`article[aria-label="Plate ${plate}"] .part`)].map((part) => {
  const [x, y] = part.getAttribute('transform').match(/-?[\\d.]+/g).map(Number);
  return [x, -y];
})"""

# The marked numbers of lines that can be seen in the editor.
MARKED_JS = """() => {
  const sheet = document.querySelector('.sheet').getBoundingClientRect();
  const seen = (box) => box.top >= sheet.top && box.bottom <= sheet.bottom;
  return [...document.querySelectorAll('.gutter .bad')].filter((n) => seen(n.getBoundingClientRect())).map((n) => n.textContent);
}"""

# Texts whose contrast with what is behind them is below WCAG's 4.5. What is greyed as a whole is meant to recede.
CONTRAST_JS = """() => {
  const canvas = document.createElement('canvas').getContext('2d', { willReadFrequently: true });
  const rgba = (color) => {
    canvas.clearRect(0, 0, 1, 1);
    canvas.fillStyle = color;
    canvas.fillRect(0, 0, 1, 1);
    return canvas.getImageData(0, 0, 1, 1).data;
  };
  const light = (color) => {
    const [r, g, b] = [...rgba(color)].slice(0, 3).map((v) => v / 255).map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const behind = (element) => {
    for (let at = element; at; at = at.parentElement) {
      const color = getComputedStyle(at).backgroundColor;
      if (rgba(color)[3] > 200) return color;
    }
    return 'white';
  };
  const receding = (element) => {
    for (let at = element; at; at = at.parentElement) if (getComputedStyle(at).opacity !== '1') return true;
    return false;
  };
  const dim = [];
  const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walk.nextNode()) {
    const element = walk.currentNode.parentElement;
    const text = walk.currentNode.textContent.trim();
    if (!text || element.closest('svg, option, noscript') || !element.checkVisibility() || receding(element)) continue;
    const [a, b] = [light(getComputedStyle(element).color), light(behind(element))];
    const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    if (ratio < 4.5) dim.push(`${ratio.toFixed(2)}: ${text.slice(0, 30)}`);
  }
  return dim;
}"""

# Elements whose content is wider than they are, or that stand out of the page or of their card.
OVERFLOW_JS = """() => {
  const over = [];
  const wide = document.documentElement.scrollWidth - innerWidth;
  if (wide > 0) over.push(`page: ${wide} px`);
  for (const element of document.querySelectorAll('body *')) {
    if (!element.checkVisibility() || element.closest('svg, textarea, .unseen-text')) continue;
    const style = getComputedStyle(element);
    const name = `${element.tagName.toLowerCase()}.${element.className}: ${element.textContent.slice(0, 25)}`;
    const more = element.scrollWidth - element.clientWidth;
    const scrolls = ['auto', 'scroll'].includes(style.overflowX) || style.textOverflow === 'ellipsis';
    if (element.clientWidth > 0 && style.display !== 'inline' && more > 1 && !scrolls) over.push(`${name} by ${more} px`);
    const box = element.getBoundingClientRect();
    if (box.right > innerWidth + 1 || box.left < -1) over.push(`${name} leaves the page`);
    const card = element.closest('.card')?.getBoundingClientRect();
    if (card && (box.right > card.right + 1 || box.left < card.left - 1)) over.push(`${name} leaves its card`);
  }
  return over;
}"""
