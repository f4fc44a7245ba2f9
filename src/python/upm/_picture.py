"""Parts in pictures."""

import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from upm._answer import answer, options
from upm._upm import UpmError


def locate(image: str | os.PathLike[str] | NDArray, **how: Any) -> dict[str, Any]:
    """Finds table and parts in a picture, as `upm locate` does, and returns what `upm locate --json` prints.

    `image` is a path, or an array of shape (height, width) or (height, width, 3), of `uint8` or `uint16`. Keyword
    arguments are the command's options with underscores: `plate_side_mm=203.2`, `coins="eu"`, `rig=…`,
    `scale="12.3px/mm"`, `corners=[(x, y), …]` in px.
    """
    if how.get("corners") is not None:
        how["corners"] = [f"{x},{y}" for x, y in how["corners"]]
    # the option takes its four places after itself once
    corners = how.pop("corners", None)
    words = options(**how) + (["--corners", *corners] if corners else [])
    if not isinstance(image, np.ndarray):
        return answer("locate", image, *words)
    with tempfile.TemporaryDirectory(prefix="upm-") as folder:
        picture = Path(folder) / "picture.pnm"
        picture.write_bytes(_pnm(image))
        try:
            return answer("locate", picture, *words)
        except UpmError as error:
            raise UpmError(str(error).replace(str(picture), "image")) from None


def _pnm(image):
    """An array as a file of the portable any-map family."""
    is_gray = image.ndim == 2
    if not (is_gray or image.ndim == 3 and image.shape[2] == 3) or image.size == 0:
        raise ValueError(f"image: expected shape (height, width) or (height, width, 3), found {image.shape}")
    if image.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"image: expected uint8 or uint16, found {image.dtype}")
    height, width = image.shape[:2]
    most = np.iinfo(image.dtype).max
    # samples of two bytes have the larger one first
    samples = np.ascontiguousarray(image, dtype=image.dtype.newbyteorder(">"))
    return f"P{5 if is_gray else 6}\n{width} {height}\n{most}\n".encode() + samples.tobytes()
