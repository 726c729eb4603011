"""The paper's Cartesian baseline: protrusions cut off along their borders and capped.

Paper, Methods, "Direct Cartesian 3D decomposition of cell surface". It knows nothing of the
cell's inside, so that the cap stands for the cortex below a protrusion; volumes that come from
voxels are the better ones, and this is what to compare them with.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from ..charts import Surface
from ..geometry.holes import boundary_loops
from ..geometry.mesh import corner_fans, signed_volume
from ..geometry.patch import fan_patch, least_bending
from ..progress import Progress, silent
from .disk import fill_labels, largest_piece, net_of

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

SUBDIVISIONS = 3
Continues = Literal["cortex", "border"]


@dataclass(frozen=True, eq=False)
class Decomposition:
    """A cell's surface taken apart into closed meshes.

    Attributes
    ----------
    protrusions : mapping of int to Surface
        A closed mesh for every label.
    cortex : Surface
        The rest, closed by the same patches.
    volumes_um3 : mapping of int to float
        Of every protrusion.
    cortex_um3 : float
        All volumes add up to the surface's.
    """

    protrusions: Mapping[int, Surface]
    cortex: Surface
    volumes_um3: Mapping[int, float]
    cortex_um3: float


def decompose(
    surface: Surface,
    labels: npt.NDArray[np.integer],
    *,
    continues: Continues = "border",
    progress: Progress | None = None,
) -> Decomposition:
    """Cut every protrusion off along its border and close it and the cell with one patch.

    Parameters
    ----------
    surface : Surface
        Closed.
    labels : ndarray, (n,) int
        One per vertex, 0 = none. Of a protrusion in several pieces the largest is cut off.
    continues : str
        "border": the patches of least bending energy that the border alone holds, which are
        harmonic; "cortex": those that continue the surface around the protrusion smoothly,
        which above a rounded neck bulge into the protrusion.
    progress : Progress, optional

    Returns
    -------
    Decomposition
        Protrusions of any genus and with several borders, each of which gets a patch.
    """
    report = progress or silent()
    owner = np.zeros(len(surface.faces), np.int64)
    names = np.unique(labels[labels > 0])
    net = net_of(surface.vertices, surface.faces)
    for name in names:
        chosen = labels == name
        filled = fill_labels(net, chosen) & (chosen | (labels == 0))
        # Faces with two corners in it: the border runs where it should, on average.
        own = (filled[surface.faces].sum(axis=1) >= 2) & (owner == 0)
        if own.any():
            piece = largest_piece(surface.vertices, surface.faces, own, across_border=True)
            owner[piece.faces_of_surface] = name
    meshes, volumes = {}, {}
    points, rest = [surface.vertices], [surface.faces[owner == 0]]
    size = len(surface.vertices)
    for number, name in enumerate(names):
        report(number / max(len(names), 1), f"capping protrusion {number + 1} of {len(names)}")
        own = surface.faces[owner == name]
        inner, faces = [surface.vertices], [own]
        start = len(surface.vertices)
        for loop in _loops(own):
            vertices, patch = _patch(surface, owner == name, loop, continues)
            new = vertices[len(loop) :]
            faces.append(np.concatenate([loop, start + np.arange(len(new))])[patch])
            rest.append(np.concatenate([loop, size + np.arange(len(new))])[patch[:, ::-1]])
            inner.append(new)
            points.append(new)
            start += len(new)
            size += len(new)
        if len(own):
            meshes[int(name)] = _used(np.concatenate(inner), np.concatenate(faces))
            volumes[int(name)] = signed_volume(meshes[int(name)].vertices, meshes[int(name)].faces)
    cortex = _used(np.concatenate(points), np.concatenate(rest))
    return Decomposition(meshes, cortex, volumes, signed_volume(cortex.vertices, cortex.faces))


def _loops(faces: Ints) -> list[Ints]:
    """Borders of faces as vertices of the surface, each in the order a filling runs along it."""
    if len(faces) == 0:
        return []
    size, fans = corner_fans(faces)
    numbers = np.zeros(size, np.int64)
    numbers[fans.ravel()] = faces.ravel()
    return [numbers[loop] for loop in boundary_loops(fans)]


def _patch(
    surface: Surface, own: npt.NDArray[np.bool_], loop: Ints, continues: Continues
) -> tuple[Floats, Ints]:
    """The patch in a loop, whose vertices come first; the patch's faces close the protrusion."""
    vertices, faces = fan_patch(surface.vertices[loop], SUBDIVISIONS)
    free = np.ones(len(vertices), bool)
    free[: len(loop)] = False
    around = np.zeros((0, 3), np.int64)
    if continues == "cortex" and len(np.unique(loop)) == len(loop):
        at_loop = np.zeros(len(surface.vertices), bool)
        at_loop[loop] = True
        around = surface.faces[~own & at_loop[surface.faces].any(axis=1)]
    others = np.setdiff1d(around, loop)
    place = np.zeros(len(surface.vertices), np.int64)
    place[loop] = np.arange(len(loop))
    place[others] = len(vertices) + np.arange(len(others))
    # The ring around faces out of the cell, the patch into it as seen from there.
    whole = np.concatenate([faces[:, ::-1], place[around]])
    points = np.concatenate([vertices, surface.vertices[others]])
    moves = np.concatenate([free, np.zeros(len(others), bool)])
    return least_bending(points, whole, moves)[: len(vertices)], faces


def _used(vertices: Floats, faces: Ints) -> Surface:
    """A mesh without the vertices that no face has."""
    used = np.unique(faces)
    place = np.zeros(len(vertices), np.int64)
    place[used] = np.arange(len(used))
    return Surface(vertices[used], place[faces])
