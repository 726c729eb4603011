"""Where the surface is bent outwards."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unwrap3d.errors import InputError
from napari_unwrap3d.measuring.bending import curvature_threshold


def test_the_threshold_tells_what_is_bent_outwards() -> None:
    rng = np.random.default_rng(0)
    values = np.concatenate([rng.normal(m, 0.05, 500) for m in (-1.0, 0.0, 1.0)])
    assert 0.1 < curvature_threshold([values[:700], values[700:]]) < 0.8
    with pytest.raises(InputError, match="three classes"):
        curvature_threshold([np.zeros(10)])
