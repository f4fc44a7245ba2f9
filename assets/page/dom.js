// Small helpers. Text goes into the page as text, never as markup.

/** A new element: `el('p', {class: 'why'}, 'text', child)`. */
export const el = (name, attributes, ...children) => filled(document.createElement(name), attributes, children);

/** A new element of a drawing. */
export const svg = (name, attributes, ...children) =>
  filled(document.createElementNS('http://www.w3.org/2000/svg', name), attributes, children);

function filled(made, attributes = {}, children = []) {
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === 'function') made.addEventListener(name, value);
    else if (typeof value === 'boolean') made.toggleAttribute(name, value);
    else made.setAttribute(name, value);
  }
  made.append(...children);
  return made;
}

/** A button; what is read aloud, where that is not its text, is its `aria-label`. */
export const button = (text, click, attributes) => el('button', { type: 'button', click, ...attributes }, text);

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
export const announce = (text) => document.getElementById('spoken').replaceChildren(text);

export const nap = (ms) => new Promise((done) => setTimeout(done, ms));

/** Waits until the tab can be seen. */
export async function inSight() {
  if (document.hidden) await new Promise((seen) => document.addEventListener('visibilitychange', seen, { once: true }));
}

/** A button that does its work at the second press, so that a slip of the hand does nothing. */
export function twice(text, sure, act, label) {
  let asked = 0;
  let back = 0;
  const rest = () => {
    asked = 0;
    setText(made, text);
    made.classList.remove('sure');
  };
  const press = () => {
    clearTimeout(back);
    const now = performance.now();
    if (asked && now - asked > 400) {
      rest();
      act();
      return;
    }
    if (!asked) announce(sure);
    asked ||= now;
    setText(made, sure);
    made.classList.add('sure');
    back = setTimeout(rest, 4000);
  };
  const made = button(text, press, label ? { 'aria-label': label } : {});
  return made;
}
