"""The colours of the views, for plots of matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from napari.utils.colormaps import ensure_colormap

from ...fields import colours_of

if TYPE_CHECKING:
    from .colouring import Colouring

STEPS = 256


def shown_colours(
    colouring: Colouring | None, field: str, values: npt.NDArray[Any]
) -> tuple[Any, float, float]:
    """Colormap of matplotlib and limits that a field is drawn with.

    Those of the views where they show the field, its own else.

    Parameters
    ----------
    colouring : Colouring or None
    field : str
    values : ndarray
        From which its own limits follow.
    """
    from matplotlib.colors import ListedColormap

    if colouring is not None and colouring.field == field:
        colormap, (low, high) = colouring.colormap, colouring.limits
    else:
        own = colours_of(field, values)
        colormap, (low, high) = ensure_colormap(own.colormap), own.limits
    steps = colormap.map(np.linspace(0.0, 1.0, STEPS))
    return ListedColormap(steps), float(low), float(high)
