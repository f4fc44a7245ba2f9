// Small helpers. Text goes into the page as text, never as markup.

/** A new element: `el('p', {class: 'why'}, 'text', child)`. */
export function el(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  set(made, attributes);
  made.append(...children);
  return made;
}

/** A new element of a drawing. */
export function svg(name, attributes = {}, ...children) {
  const made = document.createElementNS('http://www.w3.org/2000/svg', name);
  set(made, attributes);
  made.append(...children);
  return made;
}

function set(element, attributes) {
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === 'function') element.addEventListener(name, value);
    else if (typeof value === 'boolean') element.toggleAttribute(name, value);
    else element.setAttribute(name, value);
  }
}

/** Writes text where it is another one: a screen reader hears what changes, a selection stays. */
export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

export function show(element, shown) {
  if (element.hidden === shown) element.hidden = !shown;
}

/** Has `parent` hold exactly `children`, in order, without touching those that stand right. */
export function setChildren(parent, children) {
  children.forEach((child, i) => {
    if (parent.children[i] !== child) parent.insertBefore(child, parent.children[i] ?? null);
  });
  while (parent.children.length > children.length) parent.lastElementChild.remove();
}

/** Tells those who hear the page that something changed. */
export function announce(text) {
  document.getElementById('spoken').textContent = text;
}

/** Waits until the tab can be seen. */
export async function inSight() {
  if (document.hidden) await new Promise((seen) => document.addEventListener('visibilitychange', seen, { once: true }));
}

/** A button that does its work at the second press, so that a slip of the hand does nothing. */
export function twice(text, sure, act) {
  let asked = 0;
  let back = 0;
  const button = el('button', { type: 'button' }, text);
  const rest = () => {
    asked = 0;
    setText(button, text);
    button.classList.remove('sure');
  };
  button.addEventListener('click', () => {
    clearTimeout(back);
    const now = performance.now();
    if (asked && now - asked > 400) {
      rest();
      act(button);
      return;
    }
    if (!asked) announce(sure);
    asked ||= now;
    setText(button, sure);
    button.classList.add('sure');
    back = setTimeout(rest, 4000);
  });
  return button;
}
