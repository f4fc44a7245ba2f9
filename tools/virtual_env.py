"""Scripts that need packages from PyPI run in a folder of their own."""
import os
import pathlib
import re
import subprocess
import sys


def enter_venv(folder, packages, modules=None):
    """Starts the running script again in the venv `folder`, made and filled with `packages` where they are missing.

    `modules` are the names they are imported by, where those are not the packages' own.
    """
    python = folder / "bin/python"
    if pathlib.Path(sys.prefix).resolve() == folder.resolve():
        return
    modules = modules or [re.split("[<>=]", package)[0] for package in packages]
    present = [python, "-c", f"import {', '.join(modules)}"]
    if not python.exists() or subprocess.run(present, capture_output=True).returncode:
        print(f"installing {', '.join(packages)} into {folder}", file=sys.stderr, flush=True)
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", *packages], check=True)
    os.execv(python, [python, *sys.argv])
