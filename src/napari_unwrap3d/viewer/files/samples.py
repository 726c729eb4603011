"""Sample data: one simulated light-sheet cell per kind, with its truth; and a movie of one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ... import simulate
from ...charts import Stack
from ...charts.tracks import NEEDED, PLACE
from ...movie_demo import demo_stack
from ...simulate.true_tracks import true_tracks
from ..views.layers import SPACE, UNIT, LayerData

# Long enough for some blebs to come and go, small enough to be made while one waits.
TRACKED_SIZE, TRACKED_TIMEPOINTS = 80, 16


def sample(kind: str, size: int = 200, seed: int = 0) -> list[LayerData]:
    """A simulated cell as layers.

    Parameters
    ----------
    kind : str
        One of :data:`napari_unwrap3d.simulate.KINDS`.
    size : int
        Edge of the field of view in voxels of the working grid.
    seed : int

    Returns
    -------
    list of (data, attributes, type)
        The stack as the microscope recorded it, and, hidden, a label per protrusion.
    """
    cell = simulate.cell(kind, seed=seed, size=size)
    title = kind.replace("_", " ")
    common = {"units": (UNIT,) * 3, "axis_labels": SPACE}
    stack = common | {"name": title, "scale": cell.stack.voxel_size}
    labels = cell.truth.labels
    truth = common | {
        "name": f"{title}: true protrusions",
        "scale": labels.voxel_size,
        "translate": labels.origin,
        "visible": False,
    }
    return [(cell.stack.data, stack, "image"), (labels.data, truth, "labels")]


def blebs() -> list[LayerData]:
    """A cell with round blebs."""
    return sample("blebs")


def lamellipodia() -> list[LayerData]:
    """A cell with thin curved sheets."""
    return sample("lamellipodia")


def filopodia() -> list[LayerData]:
    """A cell with thin tubes."""
    return sample("filopodia")


def touching_filopodia() -> list[LayerData]:
    """A cell whose filopodia touch, so that its surface has handles."""
    return sample("touching_filopodia")


def handles() -> list[LayerData]:
    """A cell with arches, tunnels and sheets with pinholes."""
    return sample("handles")


def mix() -> list[LayerData]:
    """A cell with sheets, filopodia and blebs."""
    return sample("mix")


def blebbing() -> list[LayerData]:
    """A movie of a cell whose blebs come and go, and which drifts."""
    return [timelapse_layer(demo_stack("blebs", 0))]


def tracked_blebs() -> list[LayerData]:
    """A movie of a blebbing cell, with the true track of every bleb."""
    movie = simulate.movie("blebs", seed=1, size=TRACKED_SIZE, timepoints=TRACKED_TIMEPOINTS)
    stack = movie.stack
    # One channel: napari's tracks have no axis for channels.
    outline = replace(
        stack,
        data=stack.data[:, 0],
        axes=stack.axes.replace("c", ""),
        channels=stack.channels[:1],
        name="tracked blebs",
    )
    return [timelapse_layer(outline), tracks_layer(movie)]


def tracks_layer(movie: simulate.SimulatedMovie) -> LayerData:
    """The true tracks of a simulated movie, where its stack shows them."""
    tracks = true_tracks(movie, "stack")
    rows = np.column_stack([tracks.track_id, tracks.timepoint, tracks.position_um])
    known = (*NEEDED, *PLACE)
    attributes = {
        "name": "tracked blebs: true tracks",
        "features": {name: column for name, column in tracks.columns.items() if name not in known},
        "scale": (movie.time_step_s, 1.0, 1.0, 1.0),
        "units": ("second", *((UNIT,) * 3)),
        "axis_labels": ("t", *SPACE),
        "tail_length": TRACKED_TIMEPOINTS,
    }
    return rows, attributes, "tracks"


def timelapse_layer(stack: Stack) -> LayerData:
    """A timelapse as a layer, with its seconds and micrometres; it is read as a whole."""
    scale = {
        "t": stack.time_step or 1.0,
        "c": 1.0,
        **dict(zip(SPACE, stack.voxel_size, strict=True)),
    }
    units = {
        "t": "second" if stack.time_step else "pixel",
        "c": "pixel",
        **dict.fromkeys(SPACE, UNIT),
    }
    attributes = {
        "name": stack.name,
        "scale": tuple(scale[axis] for axis in stack.axes),
        "units": tuple(units[axis] for axis in stack.axes),
        "axis_labels": tuple(stack.axes),
    }
    return np.asarray(stack.data), attributes, "image"
