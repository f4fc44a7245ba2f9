"""Open loop."""

import json
import os
import tempfile
from pathlib import Path
from typing import Any

from upm._answer import answer
from upm._shipped import shipped


def simulate(experiment: str | os.PathLike[str] | dict[str, Any]) -> dict[str, Any]:
    """Plays given pulses on given parts, as `upm simulate` does, and returns the true trajectories it prints.

    `experiment` is a path or a mapping with the keys of an experiment file (`upm schema simulate`); files that a
    mapping names are looked for beside the shipped experiments.
    """
    if not isinstance(experiment, dict):
        return answer("simulate", experiment)
    beside = shipped() / "configs/simulate"
    with tempfile.NamedTemporaryFile("w", suffix=".json", dir=beside, encoding="utf-8") as file:
        json.dump(experiment, file)
        file.flush()
        return answer("simulate", Path(file.name))
