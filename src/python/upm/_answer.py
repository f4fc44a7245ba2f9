"""Commands that answer with JSON."""

import json

from upm._upm import answer as _answer


def answer(*args):
    """What `upm ARGS --json` prints; raises `UpmError` with the lines of a refusal."""
    return json.loads(_answer(["upm", *map(str, args)]) or "null")


def options(**values):
    """Keyword arguments as options: `plate_side_mm=200` is `--plate-side-mm 200`, `True` a flag, a list repeated."""
    words = []
    for key, value in values.items():
        option = f"--{key.replace('_', '-')}"
        if value is True:
            words.append(option)
        elif value is not None and value is not False:
            items = value if isinstance(value, (list, tuple)) else [value]
            words += [word for item in items for word in (option, str(item))]
    return words
