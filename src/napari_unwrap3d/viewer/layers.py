"""Chart → napari layers: the layer specification.

Every chart of an atlas becomes layers of one viewer. A layer is written as the
``(data, attributes, type)`` tuple that napari's readers return, so that the
widget, the project reader and the tests share one description and nothing here
needs a window.

================================ ======= ============== ================================
layer                            type    axes           placed
================================ ======= ============== ================================
mask                             labels  z, y, x        where the cell is
surface                          surface z, y, x        where the cell is
sealed surface                   surface z, y, x        where the cell is
sealed places                    points  z, y, x        where the cell is
reference                        surface z, y, x        where the cell is
sphere, sphere (conformal)       surface z, y, x        below the cell
uv: ...                          image   v, u           right of the cell
topographic surface              surface d, v, u        below the uv image
topography: mask                 labels  d, v, u        below the uv image
surface from topography          surface z, y, x        where the cell is
================================ ======= ============== ================================

All of them are in µm, because one layer in pixels makes napari drop the units of
the whole viewer. A pixel of the uv image therefore has the size that it has at the
equator of a sphere with the reference's area, ``π R / N``; the unit sphere is drawn
with the radius R; d is in µm already. ``metadata["napari_unwrap3d"]`` tells which
chart and field a layer shows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..charts import (
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
from ..errors import ChartMissingError

if TYPE_CHECKING:
    from ..atlas import Atlas

LayerData = tuple[Any, dict[str, Any], str]

KEY = "napari_unwrap3d"
UNIT = "µm"
SPACE = ("z", "y", "x")
IMAGE = ("v", "u")
NORMAL = ("d", "v", "u")
CHARTS = ("mask", "surface", "sealed", "reference", "sphere", "uv", "topography")

CURVATURE = "mean_curvature_per_um"
DIVERGING = "coolwarm"
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
    uv : (float, float)
        Upper left corner (y, x) of the uv image.
    topography : (float, float, float)
        Where (d, v, u) = (0 µm, 0, 0) is put.
    """

    origin: Size3
    radius: float
    sphere: Size3
    uv: tuple[float, float]
    topography: Size3

    @classmethod
    def around(cls, box: npt.ArrayLike, radius: float, origin: Size3 = (0.0, 0.0, 0.0)) -> Layout:
        """Lay the charts out beside `box`, the (2, 3) corners (z, y, x) of the cell in µm."""
        low, high = np.asarray(box, dtype=float)
        middle = (low + high) / 2
        height = np.pi * radius
        gap = GAP * max(2 * height, high[2] - low[2])
        # A thin cell may be narrower than the sphere below it.
        left, top = max(high[2], middle[2] + radius) + gap, low[1]
        second = top + height + gap
        sphere_y = max(high[1] + gap + radius, second + height / 2)
        return cls(
            origin=origin,
            radius=radius,
            sphere=(float(middle[0]), float(sphere_y), float(middle[2])),
            uv=(float(top), float(left)),
            topography=(float(middle[0]), float(second), float(left)),
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
    charts = {}
    for name in CHARTS:
        try:
            chart = getattr(atlas, name)
        except ChartMissingError:
            continue
        if chart is not None:
            charts[name] = chart
    return charts


def atlas_layers(atlas: Atlas) -> list[LayerData]:
    """All layers of an atlas, in the order in which they are added to a viewer.

    Parameters
    ----------
    atlas : Atlas

    Returns
    -------
    list of (data, attributes, type)
    """
    charts = atlas_charts(atlas)
    layout = Layout.of(charts)
    layers = []
    for name in reversed(charts):
        layers += chart_layers(name, charts, layout)
    return layers


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
    attributes = _attributes("mask", "mask", SPACE, visible=False, opacity=0.4)
    attributes |= {
        "scale": mask.voxel_size,
        "translate": np.add(mask.origin, layout.origin),
    }
    return [(mask.data.view(np.uint8), attributes, "labels")]


def _surface(surface: Surface, _: Mapping[str, Any], layout: Layout) -> list[LayerData]:
    attributes = _attributes("surface", "surface", SPACE, translate=layout.origin)
    return [_mesh(surface, attributes, surface.fields.get(CURVATURE))]


def _sealed(sealed: SealedSurface, _: Mapping[str, Any], layout: Layout) -> list[LayerData]:
    attributes = _attributes(
        "sealed", "sealed surface", SPACE, translate=layout.origin, visible=False
    )
    layers = [_mesh(sealed, attributes, sealed.fields.get(CURVATURE))]
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
    return [_mesh(reference, attributes, reference.fields.get(CURVATURE))]


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
        layers.append(_mesh(mesh, attributes, values))
    return layers


UV_TITLES = {
    "area_um2": "pixel area",
    "area_distortion": "area distortion",
    "conformal_error": "conformal error",
    CURVATURE: "reference curvature",
    "surface_height_um": "height",
    "surface_mean_curvature_per_um": "mean curvature",
}


def _uv(uv: UV, _: Mapping[str, Any], layout: Layout) -> list[LayerData]:
    known = [name for name in UV_TITLES if name in uv.fields]
    names = [name for name in uv.fields if name not in UV_TITLES] + known
    pixel = uv_pixel_um(uv.shape[0], layout.radius)
    layers: list[LayerData] = []
    for field in names:
        title = UV_TITLES.get(field, field.replace("_", " "))
        attributes = _attributes("uv", f"uv: {title}", IMAGE, field=field)
        attributes |= {
            "scale": (pixel, pixel),
            "translate": np.add(layout.uv, pixel / 2),
            "visible": field == names[-1],
            # In 3D, as a volume it would be one world unit thick and blurred, and as a
            # maximum projection what is below the contrast limits would be missing.
            "depiction": "plane",
            "rendering": "translucent",
        }
        values = np.asarray(uv.fields[field])
        layers.append((values, attributes | _colours(field, values), "image"))
    return layers


def uv_pixel_um(rows: int, radius: float) -> float:
    """Size in µm of a uv pixel at the equator of a sphere of this radius in µm."""
    return float(np.pi * radius / rows)


def _topography(
    topography: Topography, charts: Mapping[str, Any], layout: Layout
) -> list[LayerData]:
    _, rows, _ = topography.shape
    pixel = uv_pixel_um(rows, layout.radius)
    corner = np.add(layout.topography, (0.0, pixel / 2, pixel / 2))
    step = float(np.diff(topography.d_um).mean()) if len(topography.d_um) > 1 else 1.0
    chart = "topography"

    mask = _attributes(chart, "topography: mask", NORMAL, visible=False, opacity=0.4)
    mask |= {
        "scale": (step, pixel, pixel),
        "translate": np.add(corner, (float(topography.d_um[0]), 0.0, 0.0)),
    }
    meshed = _attributes(
        chart, "surface from topography", SPACE, translate=layout.origin, visible=False
    )
    carried = _attributes(chart, "topographic surface", NORMAL, translate=corner)
    carried["scale"] = (1.0, pixel, pixel)
    surface: Surface | None = charts.get("surface")
    values = None if surface is None else surface.fields.get(CURVATURE)
    cut, kept = flat_surface(topography)
    layers = [
        (topography.mask.view(np.uint8), mask, "labels"),
        _mesh(TriangleMesh(topography.meshed_vertices, topography.meshed_faces), meshed, None),
        _mesh(cut, carried, None if values is None else values[topography.cut_origin[kept]]),
    ]
    return layers


def flat_surface(topography: Topography) -> tuple[TriangleMesh, npt.NDArray[np.int64]]:
    """The surface over the (u, v) plane, lit from +d, and which cut vertices it has.

    Around a pole a face spans any range of u, and drawn flat it would reach far out of
    the image; the few faces that do are left out.
    """
    vertices, faces = topography.cut_vertices, topography.cut_faces
    columns = topography.shape[2]
    faces = faces[vertices[faces, 2].max(axis=1) < columns * (1 + OVERHANG)]
    kept, inverse = np.unique(faces, return_inverse=True)
    faces = facing_outwards(vertices[kept], inverse.reshape(-1, 3))
    return TriangleMesh(vertices[kept], faces), kept


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


def mesh_layer(surface: Surface, name: str, field: str = "") -> LayerData:
    """A mesh that is no chart (yet): a surface layer in µm, coloured by one of its fields."""
    attributes = _attributes("", name, SPACE)
    del attributes["metadata"]
    values = np.asarray(surface.fields[field]) if field else None
    return _mesh(surface, attributes, values, field)


def _attributes(
    chart: str, name: str, axes: tuple[str, ...], *, field: str = "", **more: Any
) -> dict[str, Any]:
    """What every layer has: name, units, axis labels, and which chart it shows."""
    return {
        "name": name,
        "units": (UNIT,) * len(axes),
        "axis_labels": axes,
        "scale": (1.0,) * len(axes),
        "metadata": {KEY: {"layer": name, "chart": chart, "field": field}},
        **more,
    }


def _mesh(
    mesh: TriangleMesh,
    attributes: dict[str, Any],
    values: npt.NDArray[Any] | None,
    field: str = CURVATURE,
) -> LayerData:
    """A surface layer, coloured by the values of a field where they are known."""
    vertices = mesh.vertices.astype(np.float32)
    faces = mesh.faces.astype(np.int32)
    attributes = {**attributes, "shading": "smooth"}
    if mesh.fields:
        attributes["features"] = {
            name: np.asarray(column) for name, column in mesh.fields.items() if column.ndim == 1
        }
    if values is None:
        plain = np.ones(len(vertices), dtype=np.float32)
        grey = {"colormap": "gray", "contrast_limits": (0.0, 1.2)}
        return (vertices, faces, plain), attributes | grey, "surface"
    if "metadata" in attributes:
        attributes["metadata"][KEY]["field"] = field
    shown = np.nan_to_num(np.asarray(values, dtype=np.float32))
    return (vertices, faces, shown), attributes | _colours(field, shown), "surface"


def _colours(field: str, values: npt.NDArray[Any]) -> dict[str, Any]:
    """Colormap and contrast limits of a field, from its 1st and 99th percentile."""
    finite = values[np.isfinite(values)].astype(float)
    low, high = np.percentile(finite, (1, 99)) if finite.size else (0.0, 1.0)
    if field.endswith(CURVATURE):
        limit = max(abs(low), abs(high)) or 1.0
        return {"colormap": DIVERGING, "contrast_limits": (-limit, limit)}
    if field == "conformal_error":
        return {"colormap": "magma", "contrast_limits": (1.0, max(high, 1.05))}
    colormap = "viridis" if field == "surface_height_um" else "magma"
    if not high > low:
        high = low + 1.0
    return {"colormap": colormap, "contrast_limits": (float(low), float(high))}
