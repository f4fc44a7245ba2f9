"""The shipped jobs, rigs and libraries as files."""

import functools
import os
import tempfile
from pathlib import Path

from upm._upm import shipped_files


@functools.cache
def shipped() -> Path:
    """Folder with the shipped files, `configs/` and `assets/`: `upm.shipped() / "configs/arrange-8.json"`.

    They are written once into the user's cache, and again where their texts differ from this version's.
    """
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "upm"
    try:
        return _write(cache)
    except OSError:
        return _write(Path(tempfile.mkdtemp(prefix="upm-")))


def _write(folder):
    for name, text in shipped_files():
        file = folder / name
        if not file.exists() or file.read_text(encoding="utf-8") != text:
            file.parent.mkdir(parents=True, exist_ok=True)
            # two processes may write at a time: each its own file, and the name at once
            part = file.with_name(f"{file.name}.{os.getpid()}")
            part.write_text(text, encoding="utf-8")
            part.replace(file)
    return folder
