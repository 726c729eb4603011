"""napari writers of surface and tracks layers; napari itself has none."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
import numpy.typing as npt

from ...files.meshes import write_mesh
from ...files.tracks import write_tracks
from ..tracks.layer_data import tracks_of_layer
from ..views.layers import COPIES, KEY
from ..views.sources import check_placement, micrometres

logger = logging.getLogger(__name__)


def write_surface(path: str, data: Any, attributes: dict[str, Any]) -> list[str]:
    """Write a surface layer as PLY, OBJ, STL, VTP or OFF, told apart by the suffix.

    Vertices are written in µm where the viewer shows them. A chart of ours is written
    in its own coordinates instead, without the place beside the cell that it was
    given: (z, y, x), or (d, v, u) for the topographic surface. Fields (the layer's
    features, and its values) go along where the format holds them.

    Parameters
    ----------
    path : str
    data : tuple
        Vertices (n, 3), faces (m, 3) and values (n,).
    attributes : dict
        What napari knows about the layer.

    Returns
    -------
    list of str
        The file that was written.
    """
    from napari.layers import Layer

    data, attributes = _whole(data, attributes)
    layer = Layer.create(data, _known(attributes), "surface")
    if KEY in layer.metadata:
        # The topographic surface is shown with d towards the viewer, and written as it is.
        layer.scale = np.abs(layer.scale)
    check_placement(layer)
    vertices = np.asarray(data[0], dtype=float) * layer.scale
    if KEY not in layer.metadata:
        vertices = vertices + layer.translate
    factors = micrometres(layer)
    if factors is None:
        logger.warning("The layer %s has no unit of length: written as it is.", layer.name)
    else:
        vertices = vertices * factors
    return [str(write_mesh(path, vertices, data[1], _fields(layer, data)))]


def write_tracks_layer(path: str, data: Any, attributes: dict[str, Any]) -> list[str]:
    """Write a Tracks layer as GEFF, CSV, Parquet or TrackMate's XML, told apart by the suffix.

    A layer of ours is written with all that is known of its tracks, on the surface and in
    space, whichever canvas it is in; of another one, places in µm where the viewer shows them.

    Parameters
    ----------
    path : str
    data : array-like, (n, 4) or (n, 5)
        (track, t, [z,] y, x).
    attributes : dict
        What napari knows about the layer.

    Returns
    -------
    list of str
        The file that was written.

    Raises
    ------
    Unwrap3DError
        See :func:`..tracks.layer_data.tracks_of_layer` and :func:`...files.tracks.write_tracks`.
    """
    tracks = tracks_of_layer(data, attributes)
    return [str(write_tracks(path, tracks, name=str(attributes.get("name", ""))))]


def _whole(data: Any, attributes: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
    """The mesh as it is without the cut that a texture needs."""
    copies = attributes.get("metadata", {}).get(KEY, {}).get(COPIES)
    if copies is None:
        return data, attributes
    size = int(copies.max()) + 1
    whole = (data[0][:size], copies[np.asarray(data[1])], *(each[:size] for each in data[2:]))
    features = attributes.get("features")
    if features is not None:
        attributes = {**attributes, "features": features[:size]}
    return whole, attributes


def _known(attributes: dict[str, Any]) -> dict[str, Any]:
    """What places and describes the vertices; how they are coloured does not matter."""
    names = ("name", "scale", "translate", "rotate", "shear", "affine", "units", "metadata")
    return {name: attributes[name] for name in names if name in attributes} | {
        "features": attributes.get("features")
    }


def _fields(layer: Any, data: Any) -> dict[str, npt.NDArray[Any]]:
    """The numeric features, and the values where no feature has them already."""
    fields = {
        str(name): np.asarray(column)
        for name, column in layer.features.items()
        if np.asarray(column).dtype.kind in "biuf"
    }
    values = np.asarray(data[2]) if len(data) > 2 else np.zeros(0)
    shown = layer.metadata.get(KEY, {}).get("field", "")
    if values.ndim == 1 and values.size and np.ptp(values) > 0 and shown not in fields:
        fields["value"] = values
    return fields
