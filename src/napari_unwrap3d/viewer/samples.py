"""Sample data: one simulated light-sheet cell per kind, with its truth."""

from __future__ import annotations

from .. import simulate
from .layers import SPACE, UNIT, LayerData


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
