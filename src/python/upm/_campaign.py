"""Campaigns."""

import concurrent.futures
import json
import os
import pathlib
from typing import Any

from upm._answer import answer


def campaign(
    file: str | os.PathLike[str],
    *,
    out: str | os.PathLike[str] | None = None,
    executor: concurrent.futures.Executor | None = None,
    shards: int = 64,
) -> dict[str, Any]:
    """Makes the runs of a campaign, as `upm campaign` does, and returns its summary, as in `summary.json`.

    `out` is the folder of the results, `campaigns/NAME` if left out: runs that it has are not made again. `executor` is
    any `concurrent.futures.Executor`; its workers see `file` and `out` under the same paths, and each makes one of the
    `shards` at a time on one core. Without one, the runs are made on all cores of this computer.
    """
    file = os.path.abspath(file)
    out = os.path.abspath(out or pathlib.Path("campaigns", json.loads(pathlib.Path(file).read_text())["name"]))
    if executor is None:
        return answer("campaign", file, "--out", out)
    tasks = [executor.submit(_shard, file, out, f"{shard}/{shards}") for shard in range(1, shards + 1)]
    for task in concurrent.futures.as_completed(tasks):
        task.result()
    return answer("campaign", "merge", out)


def _shard(file: str, out: str, shard: str) -> None:
    answer("campaign", file, "--out", out, "--shard", shard, "--jobs", "1")
