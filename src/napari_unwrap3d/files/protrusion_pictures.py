"""A picture of the protrusions: every one in its colour, from both sides and in uv."""

from __future__ import annotations

import colorsys
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..charts import MOTIFS, Floats, Ints, Protrusions
from ..geometry.mesh import vertex_normals
from .drawing import INK, PLAIN, common_extents, mesh_panel, new_figure, uv_axes
from .panels import front_and_back

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..atlas import Atlas

# Hues this part of a turn apart are far from all before; three lightnesses in turn.
TURN = (np.sqrt(5) - 1) / 2
LIGHTNESSES, SATURATION = (0.5, 0.66, 0.4), 0.75


def label_colours(count: int) -> Floats:
    """Colours (count + 1, 3) of labels: grey for 0, and neighbouring numbers far apart."""
    colours = [
        colorsys.hls_to_rgb((i * TURN) % 1.0, LIGHTNESSES[i % len(LIGHTNESSES)], SATURATION)
        for i in range(count)
    ]
    return np.array([PLAIN, *colours])


def face_labels(labels: npt.NDArray[Any], faces: Ints) -> npt.NDArray[Any]:
    """The label (m,) that most corners of a face have."""
    # Of three numbers of which two are alike, the middle one is these.
    middle: npt.NDArray[Any] = np.sort(labels[faces], axis=1)[:, 1]
    return middle


def draw_protrusions(atlas: Atlas) -> Figure:
    """The surface and the uv image coloured by protrusion; one colour is one protrusion."""
    found, surface = atlas.protrusions, atlas.surface
    figure = new_figure(11.0, 11.3, "Protrusions", _in_words(found))
    grid = figure.add_gridspec(2, 2, height_ratios=(1.1, 1))
    views = front_and_back(atlas.uv.rotation)
    colours = label_colours(int(found.labels.max(initial=0)))
    of_face = face_labels(found.labels, surface.faces)
    normals = vertex_normals(surface.vertices, surface.faces)
    extents = common_extents(surface.vertices, list(views))
    for column, side in enumerate(("front", "back")):
        axes = figure.add_subplot(grid[0, column])
        mesh_panel(
            axes,
            surface.vertices,
            surface.faces,
            of_face,
            lambda labels: colours[labels],
            views[column],
            extents[column],
            normals=normals,
        )
        axes.set_title(side, fontsize=12, color=INK)
    axes = figure.add_subplot(grid[1, :])
    image = atlas.carry(found.labels, "surface", "uv", kind="label")
    rows, columns = image.shape
    axes.imshow(
        colours[image],
        extent=(-0.5, columns - 0.5, rows - 0.5, -0.5),
        interpolation="antialiased",
    )
    uv_axes(axes, image.shape, "uv image: the outermost sheet")
    return figure


def _in_words(found: Protrusions) -> str:
    """How many there are, of which motif, and what they hold of the cell."""
    if found.count == 0:
        return "none was found"
    motifs = np.bincount(found.columns["motif"], minlength=len(MOTIFS))
    counted = [f"{n} like a {motif}" for n, motif in zip(motifs, MOTIFS, strict=True) if n]
    volume = int(np.count_nonzero(found.volume.data))
    part = volume / max(volume + int(np.count_nonzero(found.cortex.data)), 1)
    return f"{found.count} found ({', '.join(counted)}), {part:.1%} of the cell's volume"
