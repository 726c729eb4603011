"""Where the surface is bent outwards: one threshold of curvature for a whole movie.

Paper, Methods, "Bleb timeseries extraction": protrusions are on the largest part of their box that
is bent outwards by more than the higher threshold of Otsu's method with three classes.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt
from skimage.filters import threshold_multiotsu

from ..errors import InputError

CURVATURE_CLASSES = 3
LARGEST_SAMPLE = 500_000


def curvature_threshold(images: Iterable[npt.ArrayLike]) -> float:
    """The curvature above which the surface counts as bent outwards, one for a whole movie.

    The higher of the two thresholds of Otsu's method with three classes (paper, "Bleb timeseries
    extraction").

    Raises
    ------
    InputError
        There is nothing to tell three classes from.
    """
    values = np.concatenate([np.asarray(image, dtype=np.float64).ravel() for image in images])
    values = values[np.isfinite(values)]
    sample = values[:: max(len(values) // LARGEST_SAMPLE, 1)]
    if len(np.unique(sample[:1000])) < CURVATURE_CLASSES and len(np.unique(sample)) < 3:
        raise InputError(
            "The curvature does not vary enough for three classes.", values=len(np.unique(sample))
        )
    return float(threshold_multiotsu(sample, CURVATURE_CLASSES)[-1])
