// Differences between devices: names of keys, and access to the clipboard.

import { setText } from './dom.js';

const IS_MAC = /mac|iphone|ipad/i.test(navigator.userAgentData?.platform ?? navigator.platform ?? '');

/** The keys of the emergency stop, as they are printed on this device's keyboard. */
export const STOP_KEYS = IS_MAC ? ['⌘', '⌥', 'S'] : ['Ctrl', 'Alt', 'S'];
/** The same for `aria-keyshortcuts`. */
export const STOP_SHORTCUT = IS_MAC ? 'Meta+Alt+S' : 'Control+Alt+S';

/** True for a device that has no keyboard as far as can be known: it is touched. */
export const isTouched = () => matchMedia('(hover: none) and (pointer: coarse)').matches;

/** True when the keys of a stop are held: Ctrl and Alt, on a Mac ⌘ and ⌥ or the same. */
export const stopKeysHeld = (event) => event.altKey && (event.ctrlKey || (IS_MAC && event.metaKey));

/** Copies `text` and says so on `button`. Where the browser forbids it, `shown` is selected to be copied by hand. */
export async function copy(text, button, shown) {
  const name = button.textContent;
  try {
    await navigator.clipboard.writeText(text);
    setText(button, 'Copied');
  } catch {
    getSelection().selectAllChildren(shown);
    setText(button, 'Selected: copy it');
  }
  setTimeout(() => setText(button, name), 2000);
}
