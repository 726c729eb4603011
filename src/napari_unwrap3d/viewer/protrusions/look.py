"""How strongly protrusions are drawn, and how the 3D view turns to them."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ...protrusions.colours import instance_colours
from ..views.placing import chart_of

if TYPE_CHECKING:
    from ...charts import Floats
    from ..annotations.colours import Colour

# What those that are not selected are drawn with: a grey with a little of their colour in it.
GREY, OWN_SHARE, DIMMED = (0.5, 0.5, 0.5), 0.25, 0.85


def strengths(
    count: int, hidden: Collection[int], chosen: Collection[int], by_measure: bool
) -> dict[int, Colour]:
    """The colours of the labels 1 … count − 1, whose opacity says how strong they are.

    Parameters
    ----------
    count : int
    hidden : collection of int
        Labels that are not to be seen.
    chosen : collection of int
        Those that stand out; all where there are none.
    by_measure : bool
        Whether the field below is what is to be seen.
    """
    colours: dict[int, Colour] = {}
    for label, colour in instance_colours(range(1, count)).items():
        if label in hidden:
            # In a measure's colours the field would be seen.
            colours[label] = (*GREY, float(by_measure))
        elif chosen and label not in chosen:
            colours[label] = (*(GREY if by_measure else _faded(colour)), DIMMED)
        else:
            colours[label] = (*colour[:3], float(not by_measure))
    return colours


def _faded(colour: Colour) -> tuple[float, float, float]:
    red, green, blue = (
        OWN_SHARE * part + (1 - OWN_SHARE) * grey
        for part, grey in zip(colour[:3], GREY, strict=True)
    )
    return red, green, blue


def look_at(viewer: Any, vertices: Floats, chosen: npt.NDArray[np.bool_]) -> None:
    """Bring chosen vertices (n,) of the surface to the middle of the main canvas, in front."""
    if chosen.any():
        look_towards(viewer, vertices[chosen].mean(axis=0), vertices.mean(axis=0))


def look_towards(viewer: Any, place: Floats, middle: Floats | None = None) -> None:
    """Bring a place (z, y, x) of the cell to the middle of the main canvas, in front.

    Parameters
    ----------
    viewer : napari.Viewer
    place : ndarray, (3,)
    middle : ndarray, (3,), optional
        Of the cell; of the box around it unless given.
    """
    layer = next((each for each in viewer.layers if chart_of(each) == "surface"), None)
    if layer is None:
        return
    if middle is None:
        middle = np.asarray(layer.extent.data).mean(axis=0)
    outwards = place - middle
    camera = viewer.scene.camera
    camera.center = tuple(place * layer.scale[-3:] + layer.translate[-3:])
    if viewer.dims.ndisplay == 3 and np.linalg.norm(outwards) > 0:
        up = np.eye(3)[int(np.abs(outwards).argmin())]
        camera.set_view_direction(tuple(-outwards), tuple(up))
