"""Carrying scalars and labels between charts by pulling them back along the maps."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from .charts import Floats, TriangleMesh, Volume
from .errors import AxesError, ChartMissingError, ParameterError
from .geometry.interpolate import sample_linear, sample_nearest
from .geometry.locate import LabelInterpolator, interpolate
from .geometry.padding import sample_uv_label, sample_uv_linear
from .progress import Progress
from .unwrapping.direct import labels_of_owners
from .unwrapping.surface import same_mesh
from .unwrapping.uv import direction_to_uv, pixel_grid

if TYPE_CHECKING:
    from .atlas import Atlas

CHUNK = 200_000
NEAR_SURFACE_LAYERS = 3
MESHES = ("surface", "reference", "sphere")


def carry(
    atlas: Atlas, values: Any, source: str, target: str, kind: str, progress: Progress
) -> Any:
    """See :meth:`napari_unwrap3d.atlas.Atlas.carry`."""
    given = _checked(atlas, values, source, kind)
    if source == target or {source, target} == {"reference", "sphere"}:
        return given
    if source == "plane" and target == "topography":
        given, source = carry(atlas, given, "plane", "surface", kind, progress), "surface"
    if target == "topography":
        return _to_topography(atlas, given, source, kind, progress)
    if source in ("reference", "sphere") and target == "uv":
        face, weights = atlas.uv.face.ravel(), atlas.uv.weights.reshape(-1, 3)
        read = _interpolator(atlas.reference, given, kind)
        return read(face, weights).reshape(atlas.uv.shape)
    if source == "surface" and target == "uv":
        return _outermost_image(atlas, given, kind)
    if source == "surface" and target == "direct":
        return _direct_image(atlas, given, kind)
    if source == "direct" and target == "surface":
        return _from_direct(atlas, given, kind)
    points, shape = _sample_points(atlas, target)
    carried = _pull_back(atlas, given, source, target, points, kind, progress)
    carried = carried.reshape(shape)
    if target == "volume":
        return Volume(carried, atlas.mask.voxel_size, atlas.mask.origin)
    return carried


def _outermost_image(atlas: Atlas, values: npt.NDArray[Any], kind: str) -> npt.NDArray[Any]:
    """Values per vertex of the surface as the uv image of its outermost sheet."""
    outermost = atlas.outermost
    seen = outermost.face >= 0
    found = _interpolator(atlas.surface, values, kind)(
        outermost.face[seen], outermost.weights[seen]
    )
    label = kind == "label"
    image = np.full(seen.shape, 0 if label else np.nan, found.dtype if label else np.float64)
    image[seen] = found
    return image


def _direct_image(atlas: Atlas, values: npt.NDArray[Any], kind: str) -> npt.NDArray[Any]:
    """Values per vertex of the surface as the direct image: one label per owner."""
    chart = atlas.direct
    if not same_mesh(atlas.sealed, atlas.surface):
        face, weights, _ = atlas._surface_locator.closest(atlas.sealed.vertices)
        values = _interpolator(atlas.surface, values, kind)(face, weights)
    if kind == "label":
        return np.asarray(values[chart.owner])
    read = _interpolator(chart, values, kind)
    return read(chart.face.ravel(), chart.weights.reshape(-1, 3)).reshape(chart.shape)


def _from_direct(atlas: Atlas, image: npt.NDArray[Any], kind: str) -> npt.NDArray[Any]:
    """The direct image as values per vertex of the surface."""
    chart = atlas.direct
    if kind == "label":
        values = np.asarray(labels_of_owners(chart, image))
    else:
        turned = chart.vertices @ chart.rotation.T
        values = sample_uv_linear(image, direction_to_uv(turned, chart.shape[0]))
    if same_mesh(atlas.sealed, atlas.surface):
        return values
    face, weights, _ = atlas._sealed_locator.closest(atlas.surface.vertices)
    return _interpolator(atlas.sealed, values, kind)(face, weights)


def _checked(atlas: Atlas, values: Any, source: str, kind: str) -> Any:
    """The values as an array (or Volume) of the size that the chart has."""
    if kind not in ("scalar", "label"):
        raise ParameterError(f"Values are of kind 'scalar' or 'label', not {kind!r}.")
    if source == "volume":
        if not isinstance(values, Volume):
            raise AxesError(
                "Values of the volume are given as a Volume, which knows its voxel size.",
                hint="Volume(data, voxel_size, origin)",
            )
        return Volume(np.asarray(values.data), values.voxel_size, values.origin)
    expected = _shape(atlas, source)
    array = np.asarray(values)
    if array.shape != expected:
        raise AxesError(
            f"Values of {source} have the wrong size.", shape=array.shape, expected=expected
        )
    if kind == "label" and array.dtype.kind not in "iub":
        raise AxesError("Labels are integers.", dtype=str(array.dtype))
    return array


def _shape(atlas: Atlas, chart: str) -> tuple[int, ...]:
    if chart in MESHES:
        return (len(getattr(atlas, chart).vertices),)
    if chart in ("uv", "topography", "direct", "plane"):
        shape: tuple[int, ...] = getattr(atlas, chart).shape
        return shape
    raise ChartMissingError(f"Values cannot be carried from {chart!r}.")


def _sample_points(atlas: Atlas, target: str) -> tuple[Floats, tuple[int, ...]]:
    """Where the target needs values, in its own coordinates."""
    if target in MESHES:
        vertices = getattr(atlas, target).vertices
        return vertices, (len(vertices),)
    if target in ("uv", "direct", "plane"):
        shape = getattr(atlas, target).shape
        return pixel_grid(shape[0]).reshape(-1, 2), shape
    if target == "volume":
        index = np.indices(atlas.mask.shape).reshape(3, -1).T
        return atlas.mask.to_world(index), atlas.mask.shape
    raise ChartMissingError(f"Values cannot be carried to {target!r}.")


def _pull_back(
    atlas: Atlas,
    values: Any,
    source: str,
    target: str,
    points: Floats,
    kind: str,
    progress: Progress,
) -> npt.NDArray[Any]:
    """Values at the images of `points` (of the target) on the source."""
    read = _reader(atlas, values, source, kind)
    parts = []
    for begin in range(0, len(points), CHUNK):
        progress(begin / len(points), f"carrying from {source} to {target}")
        part = slice(begin, begin + CHUNK)
        image, valid = _image(atlas, points[part], source, target, part)
        found = read(image[valid])
        if kind == "label":
            result = np.zeros((len(image), *found.shape[1:]), found.dtype)
        else:
            result = np.full((len(image), *found.shape[1:]), np.nan)
        result[valid] = found
        parts.append(result)
    return np.concatenate(parts)


def _image(
    atlas: Atlas, points: Floats, source: str, target: str, part: slice
) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Images on the source; the surface's own vertices were mapped when it was unwrapped."""
    if target == "surface" and source in ("uv", "topography", "sphere", "reference"):
        topographic = atlas.topography.surface[part]
        return atlas.map(topographic, "topography", source)
    return atlas.map(points, target, source)


def _reader(
    atlas: Atlas, values: Any, source: str, kind: str
) -> Callable[[Floats], npt.NDArray[Any]]:
    """What reads the values of the source at points in its coordinates."""
    label = kind == "label"
    if source in ("uv", "direct", "plane"):
        return partial(sample_uv_label if label else sample_uv_linear, values)
    if source == "topography":
        return lambda points: _sample_topography(atlas, values, points, label)
    if source == "volume":
        return lambda points: sample_volume(values, points, label)
    at_places = _interpolator(getattr(atlas, source), values, kind)
    return lambda points: at_places(*_place(atlas, source, points))


def _interpolator(
    mesh: TriangleMesh, values: npt.NDArray[Any], kind: str
) -> Callable[[Any, Floats], npt.NDArray[Any]]:
    """What reads values given at vertices at places (face, weights)."""
    if kind == "label":
        return LabelInterpolator(values, mesh.faces).at
    return partial(interpolate, values, mesh.faces)


def _place(atlas: Atlas, source: str, points: Floats) -> tuple[Any, Any]:
    if source == "sphere":
        return atlas._sphere_locator.locate(points)
    locator = atlas._surface_locator if source == "surface" else atlas._reference_locator
    face, weights, _ = locator.closest(points)
    return face, weights


def sample_volume(
    volume: Volume, points: npt.NDArray[np.floating], label: bool
) -> npt.NDArray[Any]:
    """Values at points (..., 3) in µm; outside of the volume NaN, or 0 for labels."""
    index = volume.to_index(points)
    found = np.array((sample_nearest if label else sample_linear)(volume.data, index))
    inside = (index >= -0.5) & (index <= np.array(volume.shape) - 0.5)
    found[~inside.all(axis=-1)] = 0 if label else np.nan
    return found


def _sample_topography(
    atlas: Atlas, values: npt.NDArray[Any], points: Floats, label: bool
) -> npt.NDArray[Any]:
    """Values (D, N, 2N) at (d µm, v, u), continued over the seam and the poles."""
    from .geometry.padding import pad_sphere

    d_um = atlas.topography.d_um
    layer = (points[:, 0] - d_um[0]) / (d_um[1] - d_um[0])
    padded = pad_sphere(values, 1, axis=1)
    grid = np.column_stack([layer, points[:, 1] + 1.0, points[:, 2] + 1.0])
    return (sample_nearest if label else sample_linear)(padded, grid)


def _to_topography(
    atlas: Atlas, values: Any, source: str, kind: str, progress: Progress
) -> npt.NDArray[Any]:
    """Values at the nodes; a surface's values only at the nodes next to it."""
    chart = atlas.topography
    label = kind == "label"
    if source == "volume":
        return np.stack([sample_volume(values, layer, label) for layer in chart.positions])
    if source in ("uv", "reference", "sphere"):
        image = values if source == "uv" else carry(atlas, values, source, "uv", kind, progress)
        return np.broadcast_to(image, chart.shape).copy()
    near = _near_surface(chart.mask)
    positions = chart.positions[near].astype(np.float64)
    face, weights, _ = atlas._surface_locator.closest(positions)
    found = _interpolator(atlas.surface, values, kind)(face, weights)
    filler = 0 if label else np.nan
    result = np.full(chart.shape, filler, found.dtype if label else np.float64)
    result[near] = found
    return result


def _near_surface(mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Nodes within a few layers of where the mask changes."""
    size = 2 * NEAR_SURFACE_LAYERS - 1
    values = mask.astype(np.uint8)
    high = ndimage.maximum_filter(values, size=(size, 3, 3), mode=("nearest", "nearest", "wrap"))
    low = ndimage.minimum_filter(values, size=(size, 3, 3), mode=("nearest", "nearest", "wrap"))
    near: npt.NDArray[np.bool_] = high != low
    return near
