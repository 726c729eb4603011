"""Tracks as napari's Tracks layers, and those layers as tracks: for files of either."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
import numpy.typing as npt

from ...charts import Floats, Ints, Tracks
from ...charts.tracks import SPACE, TIMEPOINT, TRACK
from ...errors import InputError
from ...files.track_record import from_one, whole_timepoints
from ..views.layers import KEY, UNIT, LayerData
from ..views.sources import check_placement, micrometres

logger = logging.getLogger(__name__)

SECOND = "second"
AXES = ("t", *SPACE)
# What the layers of this package say about vertices, and no property of the tracks.
OWN = {TRACK, "track", TIMEPOINT, *SPACE}
LAYER = "napari layer"


def tracks_layer(tracks: Tracks, name: str) -> LayerData:
    """A Tracks layer in µm and seconds; splits and merges are its graph.

    A track that comes out of one which goes on is joined to its end, too: napari's graph knows
    of no other place.
    """
    places = [np.asarray(tracks.columns[column], np.float64) for column in SPACE]
    data = np.column_stack([tracks.track_id, tracks.timepoint, *places])
    graph: dict[int, list[int]] = {}
    for parent, child in [*tracks.splits.tolist(), *tracks.merges.tolist()]:
        graph.setdefault(child, []).append(parent)
    features = {n: column for n, column in tracks.columns.items() if n not in OWN}
    attributes = {
        "name": name,
        "features": features,
        "graph": graph,
        "scale": (tracks.time_step_s, 1.0, 1.0, 1.0),
        "units": (SECOND, *(UNIT,) * 3),
        "axis_labels": AXES,
    }
    return data, attributes, "tracks"


def tracks_of_layer(data: Any, attributes: dict[str, Any]) -> Tracks:
    """The tracks of a Tracks layer: exactly, where it is one of ours.

    Parameters
    ----------
    data : array-like, (n, 4) or (n, 5)
        (track, t, [z,] y, x) in the layer's units.
    attributes : dict
        What napari knows about the layer.

    Raises
    ------
    InputError
        The layer is rotated or mirrored, or its time has no unit, or it is no whole number of
        timepoints.
    """
    from napari.layers import Layer

    ours = attributes.get("metadata", {}).get(KEY, {}).get("tracks")
    if isinstance(ours, Tracks):
        return ours
    layer = Layer.create(data, _known(attributes), "tracks")
    check_placement(layer)
    rows = np.asarray(layer.data, np.float64)
    timepoint = whole_timepoints(rows[:, 1])
    space = _space(layer, rows[:, 2:])
    track, raised = from_one(rows[:, 0])
    features = {
        str(name): np.asarray(column)
        for name, column in layer.features.items()
        if str(name) not in OWN
    }
    splits, merges = _relations(layer.graph or {}, raised)
    return Tracks.of(
        {TRACK: track, TIMEPOINT: timepoint, **dict(zip(SPACE, space.T, strict=True)), **features},
        time_step_s=_time_step(layer),
        timepoints=int(timepoint.max(initial=0)) + 1,
        splits=splits,
        merges=merges,
        method="imported",
        numbers={"imported_from": LAYER, "layer": str(layer.name)},
    )


def _known(attributes: dict[str, Any]) -> dict[str, Any]:
    """What places and describes the vertices; how they are drawn does not matter."""
    names = ("name", "scale", "translate", "rotate", "shear", "affine", "units", "graph")
    known = {name: attributes[name] for name in (*names, "axis_labels") if name in attributes}
    return known | {"features": attributes.get("features")}


def _space(layer: Any, places: npt.NDArray[np.float64]) -> Floats:
    """(z, y, x) in µm where the viewer shows them; z is 0 in a plane."""
    count = places.shape[1]
    world = places * layer.scale[-count:] + layer.translate[-count:]
    if count < len(SPACE):
        world = np.column_stack([np.zeros(len(world)), world])
    units = layer.units[-count:]
    factors = micrometres(layer) if count == len(SPACE) else _lengths(units)
    if factors is None:
        logger.warning("The layer %s has no unit of length: written as it is.", layer.name)
        return np.asarray(world, np.float64)
    return np.asarray(world * factors, np.float64)


def _lengths(units: Any) -> npt.NDArray[np.float64] | None:
    """Of y and x in µm, with one for z before them."""
    if not all(unit.is_compatible_with("metre") for unit in units):
        return None
    return np.array([1.0, *((1 * unit).to("micrometre").magnitude for unit in units)])


def _time_step(layer: Any) -> float:
    unit = layer.units[0]
    if not unit.is_compatible_with("second"):
        raise InputError(
            f"The layer {layer.name!r} does not tell how long a timepoint is.",
            unit=str(unit),
            hint="Set the layer's scale and units along t, as in "
            "layer.scale = (2, 1, 1, 1); layer.units = ('s', 'µm', 'µm', 'µm').",
        )
    return float((float(layer.scale[0]) * unit).to("second").magnitude)


def _relations(graph: dict[int, list[int]], raised: int) -> tuple[Ints, Ints]:
    """Splits and merges of napari's graph {child: [parents]}."""
    splits: list[tuple[int, int]] = []
    merges: list[tuple[int, int]] = []
    for child, parents in graph.items():
        pairs = [(parent + raised, child + raised) for parent in parents]
        (splits if len(parents) == 1 else merges).extend(pairs)
    return np.array(splits, np.int64).reshape(-1, 2), np.array(merges, np.int64).reshape(-1, 2)
