// Places in a job as a person counts them: `task.targets_mm[2]` is target 3.

const PATH = /(?:[a-z_]+(?:\[\d+\])*\.)*[a-z_]+(?:\[\d+\])+(?:\.[a-z_]+(?:\[\d+\])*)*/g;
const AXES = ['x', 'y', 'z'];

export const counted = (count, one, more) => `${count} ${count === 1 ? one : more}`;

/** Parts are numbered as on the plate, where an entry of the job's list may stand for several. */
function part(index, entries) {
  const counts = entries.map((entry) => entry?.count ?? 1);
  const from = counts.slice(0, index).reduce((sum, count) => sum + count, 1);
  return counts[index] > 1 ? `parts ${from} to ${from + counts[index] - 1}` : `part ${from}`;
}

/** A text with its paths in words; `job` is what the text is about, as far as it can be read. */
export function inWords(text, job) {
  const word = (member) => {
    const [, name, ...indices] = /^([a-z_]+)(?:\[(\d+)\])?(?:\[(\d+)\])?/.exec(member);
    const [index, axis] = indices.map(Number);
    if (!(index >= 0)) return name;
    const bare = name.replace(/_mm$/, '');
    if (!bare.endsWith('s')) return `${AXES[index] ?? index} of ${bare}`;
    if (bare === 'parts' && Array.isArray(job?.parts)) return part(index, job.parts);
    return `${axis >= 0 ? `${AXES[axis]} of ` : ''}${bare.slice(0, -1)} ${index + 1}`;
  };
  return text.replace(PATH, (path) => path.replace(/^task\./, '').split('.').map(word).reverse().join(' of '));
}
