"""Rendered canvases compared with stored thumbnails.

``UPDATE_THUMBNAILS=1`` in the environment writes them anew; look at them before a commit.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

THUMBNAILS = Path(__file__).parent / "thumbnails"
BACKGROUND = (255, 0, 255)
# Mean difference of all values, and the share of pixels that may differ by more than FAR:
# drivers draw edges and light a little differently.
MEAN, FAR, SHARE = 6.0, 48, 0.03

Picture = npt.NDArray[np.uint8]


def picture(qt_viewer: Any, size: tuple[int, int] = (48, 96)) -> Picture:
    """What a canvas shows without what is empty around it, (*size, 3), whatever its own size.

    Parameters
    ----------
    qt_viewer : napari.qt.QtViewer
    size : (int, int)
        Rows and columns of the thumbnail.
    """
    from skimage.transform import resize

    qt_viewer.viewer.canvas.background_color_override = tuple(c / 255 for c in BACKGROUND)
    drawn = qt_viewer.screenshot(flash=False)[..., :3]
    shown = (np.abs(drawn.astype(int) - BACKGROUND) > 8).any(axis=2)
    assert shown.any(), "nothing is drawn"
    rows, columns = (np.flatnonzero(shown.any(axis=axis)) for axis in (1, 0))
    cropped = drawn[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    small = resize(cropped, (*size, 3), anti_aliasing=True, preserve_range=True)
    return np.asarray(small.round(), dtype=np.uint8)


def difference(one: Picture, other: Picture) -> tuple[float, float]:
    """Mean difference of two pictures, and the share of pixels that are far off."""
    apart = np.abs(one.astype(float) - other)
    return float(apart.mean()), float((apart.max(axis=2) > FAR).mean())


def alike(one: Picture, other: Picture) -> bool:
    """Whether two pictures are the same but for how a driver draws."""
    mean, share = difference(one, other)
    return one.shape == other.shape and mean <= MEAN and share <= SHARE


def assert_looks_like(drawn: Picture, name: str) -> None:
    """Fail unless a picture is like the stored thumbnail of this name."""
    from skimage.io import imread, imsave

    path = THUMBNAILS / f"{name}.png"
    if os.environ.get("UPDATE_THUMBNAILS"):
        THUMBNAILS.mkdir(exist_ok=True)
        imsave(path, drawn, check_contrast=False)
    assert path.exists(), f"{path} is missing: UPDATE_THUMBNAILS=1 makes it"
    expected = np.asarray(imread(path))[..., :3]
    if not alike(drawn, expected):
        found = Path(tempfile.mkdtemp(prefix="thumbnail-")) / path.name
        imsave(found, drawn, check_contrast=False)
        mean, share = difference(drawn, expected)
        raise AssertionError(f"{found} differs from {path}: mean {mean:.1f}, far off {share:.1%}")
