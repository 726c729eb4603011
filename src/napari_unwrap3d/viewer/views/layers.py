"""Chart → napari layers: the layer specification.

Every chart of an atlas becomes layers of one of the two canvases. A layer is written as
the ``(data, attributes, type)`` tuple that napari's readers return, so that the widget,
the project reader and the tests share one description and nothing here needs a window.

napari's own canvas, in µm, because one layer in pixels makes napari drop the units of
the whole viewer:

================================ ======= ============== ================================
layer                            type    axes           placed
================================ ======= ============== ================================
mask                             image   z, y, x        where the cell is
surface                          surface z, y, x        where the cell is
sealed surface                   surface z, y, x        where the cell is
sealed places                    points  z, y, x        where the cell is
cell at t                        surface z, y, x        where the cell is, of a movie
reference                        surface z, y, x        where the cell is
sphere, sphere (conformal)       surface z, y, x        right of the cell
topographic surface              surface d, v, u        below the cell
surface from topography          surface z, y, x        where the cell is
================================ ======= ============== ================================

The canvas of the unwrapped charts, in pixels, so that a position there is an index:

================================ ======= ============== ================================
uv, direct, plane                image   v, u           at zero
topography                       image   d, v, u        at zero; d in layers
================================ ======= ============== ================================

In µm a pixel of the topographic surface has the size that a uv pixel has at the equator
of a sphere with the reference's area, ``π R / N``; the unit sphere is drawn with the
radius R; d is in µm already. ``metadata["napari_unwrap3d"]`` tells which chart and field
a layer shows, and for a layer that is coloured by a field, on which chart its values
are (``values_on``) and at which of that chart's vertices (``vertices``, all if missing).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ...charts import (
    UV,
    Mask,
    Reference,
    SealedSurface,
    Size3,
    Sphere,
    Surface,
    Topography,
    TriangleMesh,
)
from ...fields import CURVATURE, REFERENCE_CURVATURE, colours_of

if TYPE_CHECKING:
    from ...atlas import Atlas
    from ...motion.shown_frames import ShownFrame

LayerData = tuple[Any, dict[str, Any], str]

KEY = "napari_unwrap3d"
UNIT = "µm"
SPACE = ("z", "y", "x")
IMAGE = ("v", "u")
NORMAL = ("d", "v", "u")
PIXELS = "pixel"
CHARTS = ("mask", "surface", "sealed", "reference", "sphere", "uv", "topography")
# The surface of one timepoint of a movie: its chart, and its layer.
FRAME, CELL_AT_T = "frame", "cell at t"
# The charts of the second canvas.
UNWRAPPED = ("uv", "direct", "plane", "topography")

# In a layer's metadata, of a mesh that was cut for a texture: whose copy each vertex is.
COPIES = "copies_of"
# In a mesh's metadata: the vertices where its field has no value, which a mesh cannot say.
MISSING = "without_value"

# Nothing outside of the cell.
MASK_COLOURS = np.array([[0.0, 0.0, 0.0, 0.0], [0.45, 0.75, 0.95, 1.0]])
MASK_OPACITY = 0.5
# For the graphics card bytes are 0..1, and napari gives it the threshold as it is.
INSIDE = 255

GAP = 0.08
OVERHANG = 0.02


@dataclass(frozen=True)
class Layout:
    """Where the charts lie in the viewer, in µm.

    Attributes
    ----------
    origin : (float, float, float)
        Added to every position in space: the corner of the source layer.
    radius : float
        Radius of a sphere with the area of the reference.
    sphere : (float, float, float)
        Centre (z, y, x) of the sphere.
    topography : (float, float, float)
        Where (d, v, u) = (0 µm, 0, 0) is put.
    """

    origin: Size3
    radius: float
    sphere: Size3
    topography: Size3

    @classmethod
    def around(cls, box: npt.ArrayLike, radius: float, origin: Size3 = (0.0, 0.0, 0.0)) -> Layout:
        """Lay the charts out beside `box`, the (2, 3) corners (z, y, x) of the cell in µm."""
        low, high = np.asarray(box, dtype=float)
        middle = (low + high) / 2
        gap = GAP * max(2 * np.pi * radius, high[2] - low[2])
        right = high[2] + gap
        below = max(high[1], middle[1] + radius) + gap
        # Centred under the cell and the sphere.
        left = (low[2] + right + 2 * radius) / 2 - np.pi * radius
        return cls(
            origin=origin,
            radius=radius,
            sphere=(float(middle[0]), float(middle[1]), float(right + radius)),
            topography=(float(middle[0]), float(below), float(left)),
        )

    @classmethod
    def of(
        cls,
        charts: Mapping[str, Any],
        origin: Size3 = (0.0, 0.0, 0.0),
        box: npt.ArrayLike | None = None,
    ) -> Layout:
        """The layout of the given charts; `box` is what else must not be covered."""
        surface: TriangleMesh = charts["surface"] if "surface" in charts else charts["reference"]
        corners = np.array([surface.vertices.min(axis=0), surface.vertices.max(axis=0)])
        corners += np.asarray(origin)
        if box is not None:
            other = np.asarray(box, dtype=float)
            corners[0] = np.minimum(corners[0], other[0])
            corners[1] = np.maximum(corners[1], other[1])
        area = mesh_area(charts.get("reference", surface))
        return cls.around(corners, float(np.sqrt(area / (4 * np.pi))), origin)


def mesh_area(mesh: TriangleMesh) -> float:
    """Area of a mesh in the square of its unit."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def chart_of_step(step: str) -> str:
    """The chart that a step of the pipeline makes: the stack's is the mask."""
    return "mask" if step == "stack" else step


def atlas_charts(atlas: Atlas) -> dict[str, Any]:
    """The charts that an atlas has, by name."""
    return {name: getattr(atlas, name) for name in CHARTS if atlas.has(name)}


def atlas_layers(atlas: Atlas, *, unwrapped: bool = False) -> list[LayerData]:
    """All layers of an atlas for one canvas, in the order in which they are added to it.

    Parameters
    ----------
    atlas : Atlas
    unwrapped : bool
        Those for the canvas of the unwrapped charts, not for napari's own.

    Returns
    -------
    list of (data, attributes, type)
    """
    charts = atlas_charts(atlas)
    layout = Layout.of(charts)
    layers = []
    for name in reversed(charts):
        layers += chart_layers(name, charts, layout)
    return split_layers(layers)[unwrapped]


def split_layers(layers: Iterable[LayerData]) -> tuple[list[LayerData], list[LayerData]]:
    """Layers for napari's own canvas, and those for the canvas of the unwrapped charts."""
    own: list[LayerData] = []
    unwrapped: list[LayerData] = []
    for layer in layers:
        (unwrapped if layer[1]["metadata"][KEY]["unwrapped"] else own).append(layer)
    return own, unwrapped


def chart_layers(name: str, charts: Mapping[str, Any], layout: Layout) -> list[LayerData]:
    """The layers that show one chart.

    Parameters
    ----------
    name : str
        One of :data:`CHARTS`.
    charts : mapping
        All charts known so far, by name: a chart may be coloured by another's field.
    layout : Layout
        Where it goes.
    """
    return _MAKERS[name](charts[name], charts, layout)


def _mask(mask: Mask, _: Mapping[str, Any], layout: Layout) -> list[LayerData]:
    """An image, lit from the viewer: napari takes four times as long to insert labels in 3D."""
    attributes = _attributes("mask", "mask", SPACE, visible=False, opacity=MASK_OPACITY)
    attributes |= {
        "scale": mask.voxel_size,
        "translate": np.add(mask.origin, layout.origin),
        "colormap": MASK_COLOURS,
        "contrast_limits": (0.0, INSIDE),
        "rendering": "iso",
        "iso_threshold": 0.5,
        "interpolation2d": "nearest",
    }
    return [(mask.data.view(np.uint8) * np.uint8(INSIDE), attributes, "image")]


def _surface(surface: Surface, _: Mapping[str, Any], layout: Layout) -> list[LayerData]:
    attributes = _attributes("surface", "surface", SPACE, translate=layout.origin)
    return [_mesh(surface, attributes, surface.fields.get(CURVATURE), on="surface")]


def _sealed(sealed: SealedSurface, _: Mapping[str, Any], layout: Layout) -> list[LayerData]:
    attributes = _attributes(
        "sealed", "sealed surface", SPACE, translate=layout.origin, visible=False
    )
    layers = [_mesh(sealed, attributes, sealed.fields.get(CURVATURE), on="sealed")]
    if sealed.sealed:
        layers.append(_sealed_places(sealed, layout))
    return layers


def _sealed_places(sealed: SealedSurface, layout: Layout) -> LayerData:
    """A ring where a handle, hole or cavity was closed, so that no repair goes unseen."""
    volumes = np.array([float(item["volume_um3"]) for item in sealed.sealed])
    attributes = _attributes("sealed", "sealed places", SPACE, translate=layout.origin)
    attributes |= {
        "features": {"kind": [str(i["kind"]) for i in sealed.sealed], "volume_um3": volumes},
        "size": np.maximum(2 * np.cbrt(volumes), 0.02 * np.ptp(sealed.vertices, axis=0).max()),
        "symbol": "ring",
        "face_color": "orange",
        "border_color": "orange",
        "blending": "translucent_no_depth",
    }
    return np.array([item["position_um"] for item in sealed.sealed]), attributes, "points"


def _reference(reference: Reference, _: Mapping[str, Any], layout: Layout) -> list[LayerData]:
    attributes = _attributes(
        "reference", "reference", SPACE, translate=layout.origin, visible=False
    )
    return [_mesh(reference, attributes, reference.fields.get(CURVATURE), on="reference")]


def _sphere(sphere: Sphere, charts: Mapping[str, Any], layout: Layout) -> list[LayerData]:
    """Both states, coloured by the curvature of the reference: they share its vertices."""
    reference: Reference | None = charts.get("reference")
    values = None if reference is None else reference.fields.get(CURVATURE)
    layers = []
    states = (("sphere (conformal)", sphere.conformal, False), ("sphere", sphere.vertices, True))
    for name, vertices, visible in states:
        attributes = _attributes("sphere", name, SPACE, translate=layout.sphere, visible=visible)
        attributes["scale"] = (layout.radius,) * 3
        mesh = TriangleMesh(vertices, sphere.faces, sphere.fields)
        layers.append(_mesh(mesh, attributes, values, on="sphere"))
    return layers


def _uv(uv: UV, charts: Mapping[str, Any], layout: Layout) -> list[LayerData]:
    """The image of what lies outermost, or of the reference while that is not known."""
    outermost = uv.fields.get(f"surface_{CURVATURE}")
    if outermost is not None:
        return [image_layer("uv", outermost, CURVATURE)]
    values = uv.fields.get(CURVATURE, np.zeros(uv.shape))
    return [image_layer("uv", values, REFERENCE_CURVATURE)]


def image_layer(chart: str, values: npt.ArrayLike, field: str) -> LayerData:
    """The image of a field on an unwrapped chart, in pixels.

    Parameters
    ----------
    chart : str
        "uv", "direct" or "plane".
    values : ndarray, (N, 2N)
    field : str
        What they are, see :mod:`napari_unwrap3d.fields`.
    """
    image = np.asarray(values, dtype=np.float32)
    attributes = _attributes(chart, chart, IMAGE, field=field, unit=PIXELS)
    attributes["metadata"][KEY]["values_on"] = chart
    return image, attributes | _colours(field, image), "image"


def volume_layer(values: npt.NDArray[Any]) -> LayerData:
    """What the topography holds in (d, v, u), the cell's mask or a signal, in pixels.

    Parameters
    ----------
    values : ndarray, (D, N, 2N)
    """
    attributes = _attributes("topography", "topography", NORMAL, unit=PIXELS)
    if values.dtype == np.bool_:
        values = values.view(np.uint8)
        limits = (0.0, 1.0)
    else:
        limits = colours_of("", values).limits
    return values, attributes | {"colormap": "gray", "contrast_limits": limits}, "image"


def uv_pixel_um(rows: int, radius: float) -> float:
    """Size in µm of a uv pixel at the equator of a sphere of this radius in µm."""
    return float(np.pi * radius / rows)


def _topography(
    topography: Topography, charts: Mapping[str, Any], layout: Layout
) -> list[LayerData]:
    _, rows, _ = topography.shape
    pixel = uv_pixel_um(rows, layout.radius)
    corner = np.add(layout.topography, (0.0, pixel / 2, pixel / 2))
    chart = "topography"
    meshed = _attributes(
        chart, "surface from topography", SPACE, translate=layout.origin, visible=False
    )
    carried = _attributes(chart, "topographic surface", NORMAL, translate=corner, visible=False)
    # The viewer's first axis points away: turned around, what protrudes comes nearer.
    carried["scale"] = (-1.0, pixel, pixel)
    surface: Surface | None = charts.get("surface")
    values = None if surface is None else surface.fields.get(CURVATURE)
    cut, kept = flat_surface(topography)
    vertices = topography.cut_origin[kept]
    carried["metadata"][KEY]["vertices"] = vertices
    flat = None if values is None else values[vertices]
    return [
        volume_layer(topography.mask),
        _mesh(TriangleMesh(topography.meshed_vertices, topography.meshed_faces), meshed, None),
        _mesh(cut, carried, flat, on="surface"),
    ]


def flat_surface(topography: Topography) -> tuple[TriangleMesh, npt.NDArray[np.int64]]:
    """The surface over the (u, v) plane, lit from +d, and which cut vertices it has.

    Around a pole a face spans any range of u, and drawn flat it would reach far out of
    the image; the few faces that do are left out.
    """
    return flattened(topography.cut_vertices, topography.cut_faces, topography.shape[2])


def flattened(
    vertices: npt.NDArray[Any], faces: npt.NDArray[Any], columns: int
) -> tuple[TriangleMesh, npt.NDArray[np.int64]]:
    """As :func:`flat_surface`, of a mesh in (d, v, u) that was cut at the seam."""
    faces = faces[vertices[faces, 2].max(axis=1) < columns * (1 + OVERHANG)]
    kept, inverse = np.unique(faces, return_inverse=True)
    faces = facing_outwards(vertices[kept], inverse.reshape(-1, 3))
    return TriangleMesh(vertices[kept], faces), kept


def flat_frame(shown: ShownFrame) -> tuple[TriangleMesh, npt.NDArray[np.int64]]:
    """A timepoint's surface over the (u, v) plane, and the vertices that it has."""
    vertices, faces, origin = shown.cut
    mesh, kept = flattened(vertices, faces, 2 * shown.rows)
    return mesh, origin[kept]


def facing_outwards(vertices: npt.NDArray[Any], faces: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Faces (k, 3) of a mesh over (d, v, u) wound so that it is lit from +d.

    (d, v, u) is left-handed in space, so the winding of the cell's surface may have
    to be turned to face the viewer. What counts is the area that the mesh covers.
    """
    a, b, c = (vertices[faces[:, i], 1:] for i in range(3))
    first, second = b - a, c - a
    covered = float((first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]).sum())
    return faces if covered > 0 else faces[:, ::-1]


_MAKERS: dict[str, Any] = {
    "mask": _mask,
    "surface": _surface,
    "sealed": _sealed,
    "reference": _reference,
    "sphere": _sphere,
    "uv": _uv,
    "topography": _topography,
}


def frame_layer(
    vertices: npt.NDArray[Any], faces: npt.NDArray[Any], origin: npt.NDArray[np.int64]
) -> LayerData:
    """The mesh of a timepoint of a movie, cut at the seam; coloured when its field is known.

    Parameters
    ----------
    vertices : ndarray, (p, 3)
    faces : ndarray, (m, 3)
    origin : ndarray, (p,)
        The vertex of the frame's surface that each is a copy of.
    """
    attributes = _attributes(FRAME, CELL_AT_T, SPACE)
    attributes["metadata"][KEY] |= {"values_on": FRAME, "vertices": origin}
    return _mesh(TriangleMesh(vertices, faces), attributes, None)


def mesh_layer(surface: Surface, name: str, field: str = "") -> LayerData:
    """A mesh that is no chart (yet): a surface layer in µm, coloured by one of its fields."""
    attributes = _attributes("", name, SPACE)
    del attributes["metadata"]
    values = np.asarray(surface.fields[field]) if field else None
    return _mesh(surface, attributes, values, field)


def _attributes(
    chart: str,
    name: str,
    axes: tuple[str, ...],
    *,
    field: str = "",
    unit: str = UNIT,
    **more: Any,
) -> dict[str, Any]:
    """What every layer has: name, units, axis labels, and which chart it shows."""
    known = {"layer": name, "chart": chart, "field": field, "unwrapped": unit == PIXELS}
    return {
        "name": name,
        "units": (unit,) * len(axes),
        "axis_labels": axes,
        "scale": (1.0,) * len(axes),
        "metadata": {KEY: known},
        **more,
    }


def _mesh(
    mesh: TriangleMesh,
    attributes: dict[str, Any],
    values: npt.NDArray[Any] | None,
    field: str = CURVATURE,
    *,
    on: str = "",
) -> LayerData:
    """A surface layer, coloured by the values of a field where they are known.

    `on` is the chart whose vertices it has, when it is coloured with the others.
    """
    vertices = mesh.vertices.astype(np.float32)
    faces = mesh.faces.astype(np.int32)
    attributes = {**attributes, "shading": "smooth"}
    if mesh.fields:
        attributes["features"] = {
            name: np.asarray(column) for name, column in mesh.fields.items() if column.ndim == 1
        }
    if on:
        attributes["metadata"][KEY]["values_on"] = on
    if values is None:
        plain = np.ones(len(vertices), dtype=np.float32)
        grey = {"colormap": "gray", "contrast_limits": (0.0, 1.2)}
        return (vertices, faces, plain), attributes | grey, "surface"
    if "metadata" in attributes:
        attributes["metadata"][KEY]["field"] = field
    shown = np.nan_to_num(np.asarray(values, dtype=np.float32))
    return (vertices, faces, shown), attributes | _colours(field, shown), "surface"


def _colours(field: str, values: npt.NDArray[Any]) -> dict[str, Any]:
    """What a layer that shows a field is coloured with."""
    colours = colours_of(field, values)
    return {"colormap": colours.colormap, "contrast_limits": colours.limits}
