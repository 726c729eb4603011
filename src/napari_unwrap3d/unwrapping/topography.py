"""Steps 5 and 6: the (d, u, v) space normal to the reference, and the surface in it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from scipy.spatial import cKDTree

from ..charts import (
    UV,
    Floats,
    Ints,
    Mask,
    Reference,
    Sphere,
    Surface,
    Topography,
    Volume,
)
from ..geometry.curvilinear import (
    evaluate,
    in_columns,
    invert,
    repeat_ends,
    rows_from_v,
    trim_folded,
    v_from_rows,
)
from ..geometry.interpolate import sample_placed
from ..geometry.locate import SphericalLocator, interpolate
from ..geometry.padding import wrap_uv
from ..geometry.parallel import ranges, run_blocks
from ..geometry.streamlines import trace_into
from ..parameters import SurfaceParameters, TopographyParameters
from ..progress import Progress
from .active_contour import automatic_step, contour_nodes
from .normal_field import NormalField, normal_field
from .topographic_surface import cut_at_seam, faces_in_columns, mesh_mapped_mask
from .uv import uv_to_direction

PAPER_DEPTH_VOXELS = 20.0
COLUMNS_PER_BLOCK = 8192
LAYERS_PER_BLOCK = 2
# A point counts as mapped when the map brings it back to within this many voxels.
FOUND_VOXELS = 1e-3
NEWTON_ITERATIONS = 40
STARTS = 6
# A vertex needs the columns within so many pixels around it.
NEEDED_PIXELS = 3


def topography(
    surface: Surface,
    mask: Mask,
    reference: Reference,
    sphere: Sphere,
    uv: UV,
    parameters: TopographyParameters,
    surface_parameters: SurfaceParameters,
    progress: Progress,
    enclosed: Floats | None = None,
) -> Topography:
    """Propagate the reference along its normals and map the cell into (d, u, v).

    Parameters
    ----------
    surface : Surface
        Carried through the inverse map, vertex by vertex.
    mask : Mask
        The same cell as a volume, mapped by interpolation and meshed as in the paper.
    reference, sphere, uv
        The charts of Steps 1–4.
    enclosed : ndarray, (k, 3), optional
        Points in µm that the space has to hold besides the surface: where the cell is at other
        timepoints.
    """
    assert reference.mask is not None
    held = surface.vertices if enclosed is None else np.concatenate([surface.vertices, enclosed])
    field = normal_field(reference.mask, held, progress.part(0.0, 0.2))
    step = parameters.step_voxels
    if parameters.automatic_step:
        step = automatic_step(uv.positions, mask.voxel_size[0])
    inward, outward, voxel_step = _extent(field, held, parameters, step)
    start, part = _start_points(reference, sphere, uv), progress.part(0.2, 0.55)
    if parameters.propagation == "active_contour":
        nodes, first_layer = contour_nodes(
            field, start, inward, outward, voxel_step, parameters, part
        )
    else:
        nodes, first_layer = trace_nodes(field, start, inward, outward, voxel_step, part)
    edge = mask.voxel_size[0]
    step_um = voxel_step * edge
    _to_um(nodes, edge, field.distance.origin)
    del field, start  # the directions are as large as a good part of the nodes
    progress(0.6, "mapping the surface")
    d_um = np.asarray((np.arange(len(nodes)) - inward) * step_um, dtype=np.float64)
    locator = TopographyLocator(nodes, d_um, edge)
    image, _ = locator.locate(held, progress.part(0.6, 0.7))
    progress(0.7, "checking the Jacobian")
    low, high = _layers_needed(image, d_um, first_layer.shape, inward)
    last_layer = np.full(first_layer.shape, len(nodes) - 1)
    part = progress.part(0.7, 0.8)
    folded = trim_folded(nodes, first_layer, last_layer, inward, low, high, part)
    for row in (0, -1):  # all columns of a pole are one and the same
        first_layer[row], last_layer[row] = first_layer[row].max(), last_layer[row].min()
    repeat_ends(nodes, first_layer, last_layer)
    image = image[: len(surface.vertices)]
    grid = to_grid(image, d_um, uv.shape[0])
    image[~in_columns(grid, first_layer, last_layer)] = np.nan
    part = progress.part(0.8, 0.95)
    columns = (nodes, first_layer, last_layer)
    held_in = _parts(*columns, surface, image, mask, parameters, surface_parameters, part)
    return Topography(
        nodes=nodes,
        d_um=d_um,
        first_layer=first_layer,
        last_layer=last_layer,
        folded_cells=int(folded),
        **held_in,
    )


def with_surface(
    space: Topography,
    surface: Surface,
    image: Floats,
    mask: Mask,
    parameters: TopographyParameters,
    surface_parameters: SurfaceParameters,
    progress: Progress,
) -> Topography:
    """A (d, u, v) space with a surface in it, in the place of the one that it had.

    Parameters
    ----------
    space : Topography
        Its nodes and what its columns reach are kept, without a copy.
    surface : Surface
    image : ndarray, (n, 3)
        (d µm, v, u) of its vertices; NaN where one has no image.
    mask : Mask
        The same cell as a volume, mapped by interpolation and meshed as in the paper (Step 6).
    parameters : TopographyParameters
    surface_parameters : SurfaceParameters
    progress : Progress
    """
    columns = (space.nodes, space.first_layer, space.last_layer)
    parts = _parts(*columns, surface, image, mask, parameters, surface_parameters, progress)
    return replace(space, fields={}, **parts)


def _parts(
    nodes: npt.NDArray[np.float32],
    first_layer: Ints,
    last_layer: Ints,
    surface: Surface,
    image: Floats,
    mask: Mask,
    parameters: TopographyParameters,
    surface_parameters: SurfaceParameters,
    progress: Progress,
) -> dict[str, Any]:
    """What a topography holds of the surface in it; see :func:`with_surface`."""
    smoothing = parameters.smoothing_voxels
    # Where the paper's smoothing follows, the mapped mask is binary.
    kind = np.bool_ if smoothing else np.float32
    part = progress.part(0.0, 0.3)
    level = _mapped_level(nodes, mask, surface_parameters.smoothing_voxels, kind, part)
    meshed = mesh_mapped_mask(level, smoothing, progress.part(0.3, 1.0))
    meshed = faces_in_columns(*meshed, first_layer, last_layer)
    vertices, faces, origin = cut_at_seam(image, surface.faces, level.shape[1] - 2)
    return {
        "mask": level[:, 1:-1] > 0,
        "surface": image,
        "cut_vertices": vertices,
        "cut_faces": faces,
        "cut_origin": origin,
        "meshed_vertices": evaluate(nodes, meshed[0]),
        "meshed_faces": meshed[1],
    }


def _extent(
    field: NormalField, held: Floats, parameters: TopographyParameters, step: float
) -> tuple[int, int, float]:
    """Numbers of layers inwards and outwards, and their distance in voxels (α).

    D_out encloses all points (n, 3) in µm that are to be held. D_in is the parameter, or at
    least the paper's 40 steps of ½ voxel and as deep as they go below the reference.
    """
    edge = field.distance.voxel_size[0]
    length = field.arc_length(held)
    margin = parameters.margin_voxels
    highest = max(float(np.nanmax(length, initial=0.0)), 0.0)
    deepest = max(-float(np.nanmin(length, initial=0.0)), 0.0)
    if parameters.depth_um is None:
        depth = max(PAPER_DEPTH_VOXELS, deepest + margin)
    else:
        depth = parameters.depth_um / edge
    longest = 2.0 * max(field.distance.shape)
    inward = int(np.ceil(min(depth, longest) / step))
    outward = int(np.ceil((highest + margin) / step))
    return inward, outward, step


def _start_points(reference: Reference, sphere: Sphere, uv: UV) -> Floats:
    """The reference's points (N + 2, 2N, 3) in µm under every pixel and both poles."""
    rows, columns = uv.shape
    locator = SphericalLocator(sphere.vertices @ uv.rotation.T, sphere.faces)
    poles = uv_to_direction(np.array([[-0.5, 0.0], [rows - 0.5, 0.0]]), rows)
    face, weights = locator.locate(poles)
    ends = interpolate(reference.vertices, reference.faces, face, weights)
    first = np.broadcast_to(ends[0], (1, columns, 3))
    last = np.broadcast_to(ends[1], (1, columns, 3))
    return np.concatenate([first, uv.positions, last])


def trace_nodes(
    field: NormalField,
    start: Floats,
    inward: int,
    outward: int,
    step: float,
    progress: Progress,
) -> tuple[npt.NDArray[np.float32], Ints]:
    """Trace every column both ways (paper, Step 5, with a midpoint rule).

    Parameters
    ----------
    start : ndarray, (rows, columns, 3)
        In µm, on the reference.
    inward, outward : int
        Numbers of layers.
    step : float
        Arc length between layers in voxels.

    Returns
    -------
    nodes : ndarray, (inward + 1 + outward, rows, columns, 3) float32
        Index coordinates of the field's grid.
    first_layer : ndarray, (rows, columns) int64
        The deepest layer that each column reaches.
    """
    rows, columns = start.shape[:2]
    count = rows * columns
    nodes = np.empty((inward + 1 + outward, rows, columns, 3), np.float32)
    flat = nodes.reshape(len(nodes), count, 3)
    points = field.distance.to_index(start.reshape(-1, 3)).astype(np.float32)
    flat[inward] = points
    directions, core, radius = field.directions, field.core, field.core_radius

    def trace(part: slice) -> Ints:
        here, there = points[part], flat[:, part]
        trace_into(directions, here, step, core, 0.0, there, inward + 1, 1)
        reached = trace_into(directions, here, -step, core, radius, there, inward - 1, -1)
        return np.asarray(inward - reached)

    blocks = ranges(count, COLUMNS_PER_BLOCK)
    first = np.concatenate(run_blocks(trace, blocks, progress, "following the normals"))
    return nodes, first.reshape(rows, columns)


def _to_um(nodes: npt.NDArray[np.float32], edge: float, origin: tuple[float, float, float]) -> None:
    """From index coordinates to µm, in place."""

    def place(layers: slice) -> None:
        nodes[layers] *= np.float32(edge)
        nodes[layers] += np.asarray(origin, dtype=np.float32)

    run_blocks(place, ranges(len(nodes), LAYERS_PER_BLOCK))


def _layers_needed(
    image: Floats, d_um: Floats, shape: tuple[int, ...], reference_layer: int
) -> tuple[Ints, Ints]:
    """Lowest and highest layer of each column that the surface around it needs.

    Parameters
    ----------
    image : ndarray, (n, 3)
        (d µm, v, u) of the surface's vertices, NaN where one has no image.
    d_um : ndarray, (D,)
    shape : (N + 2, 2N)
    reference_layer : int
        Needed by every column.
    """
    found = image[np.isfinite(image).all(axis=1)]
    layer = (found[:, 0] - d_um[0]) / (d_um[1] - d_um[0])
    row = np.clip(np.rint(found[:, 1]).astype(np.int64) + 1, 0, shape[0] - 1)
    column = np.rint(found[:, 2]).astype(np.int64) % shape[1]
    low = np.full(shape, reference_layer)
    high = np.full(shape, reference_layer + 1)
    np.minimum.at(low, (row, column), np.floor(layer).astype(np.int64) - 1)
    np.maximum.at(high, (row, column), np.ceil(layer).astype(np.int64) + 1)
    size, mode = 2 * NEEDED_PIXELS + 1, ("nearest", "wrap")
    low = ndimage.minimum_filter(low, size=size, mode=mode)
    high = ndimage.maximum_filter(high, size=size, mode=mode)
    for pole in (0, -1):
        low[pole], high[pole] = low[pole].min(), high[pole].max()
    return low, high


def _mapped_level(
    nodes: npt.NDArray[np.float32], mask: Mask, smoothing: float, kind: Any, progress: Progress
) -> npt.NDArray[Any]:
    """The smoothed mask minus ½ at every node (D, N + 2, 2N), or only where it is positive.

    Parameters
    ----------
    kind : dtype
        float32, or bool, which takes a quarter of the memory.
    """
    data = ndimage.gaussian_filter(mask.data.astype(np.float32), smoothing)
    smooth = Volume(data, mask.voxel_size, mask.origin)
    level = np.empty(nodes.shape[:-1], kind)

    def sample(layers: slice) -> None:
        values = sample_volume(smooth, nodes[layers])
        values -= np.float32(0.5)
        level[layers] = values > 0 if kind is np.bool_ else values

    run_blocks(sample, ranges(len(nodes), LAYERS_PER_BLOCK), progress, "mapping the mask")
    return level


def sample_volume(volume: Volume, nodes: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Trilinear values of a volume at nodes (D, rows, columns, 3) in µm (paper, Step 5)."""
    data = np.ascontiguousarray(volume.data, dtype=np.float32)
    origin = np.asarray(volume.origin, dtype=np.float32)
    scale = (1.0 / np.asarray(volume.voxel_size)).astype(np.float32)
    values = np.empty(nodes.shape[:-1], np.float32)
    sample_placed(data, origin, scale, nodes.reshape(-1, 3), values.reshape(-1))
    return values


class TopographyLocator:
    """The inverse map (z, y, x) → (d, v, u): nearest nodes, then Newton in the cells."""

    def __init__(self, nodes: npt.NDArray[np.float32], d_um: Floats, voxel_um: float) -> None:
        self._nodes = nodes
        self._d_um = d_um
        self._tolerance = FOUND_VOXELS * voxel_um
        layers, rows, columns = nodes.shape[:3]
        row_stride = max(rows // 64, 1)
        self._layers = np.arange(0, layers, 4)
        # Without the poles, whose nodes are all one place: a start there is as good as none.
        self._rows = np.arange(1, rows - 1, row_stride)
        self._columns = np.arange(0, columns, row_stride)
        coarse = nodes[np.ix_(self._layers, self._rows, self._columns)]
        self._tree = cKDTree(coarse.reshape(-1, 3), balanced_tree=False, compact_nodes=False)
        self._shape = coarse.shape[:3]

    def locate(self, points: Floats, progress: Progress) -> tuple[Floats, npt.NDArray[np.bool_]]:
        """(d µm, v, u) of points (n, 3) in µm, NaN where not found, and whether found."""
        target = np.ascontiguousarray(points, dtype=np.float64)
        best = np.full(len(target), np.inf)
        grid = np.zeros((len(target), 3))
        start = self._starts(target)
        for attempt in range(STARTS):
            todo = np.flatnonzero(~(best < self._tolerance))
            if len(todo) == 0:
                break
            found, residual = invert(
                self._nodes,
                target[todo],
                start[todo, attempt],
                NEWTON_ITERATIONS,
                0.01 * self._tolerance,
                progress,
            )
            better = residual < best[todo]
            best[todo[better]], grid[todo[better]] = residual[better], found[better]
        valid = best < self._tolerance
        image = self._from_grid(grid)
        image[~valid] = np.nan
        return image, valid

    def _starts(self, target: Floats) -> Floats:
        """Grid coordinates (n, STARTS, 3) of the nearest coarse nodes."""
        _, index = self._tree.query(target, k=STARTS)
        layer, row, column = np.unravel_index(index, self._shape)
        picked = (self._layers[layer], self._rows[row], self._columns[column])
        return np.stack(picked, axis=-1).astype(np.float64)

    def _from_grid(self, grid: Floats) -> Floats:
        rows = self._nodes.shape[1] - 2
        d = np.interp(grid[:, 0], np.arange(len(self._d_um)), self._d_um)
        v = v_from_rows(grid[:, 1], rows)
        vu = wrap_uv(np.stack([v, grid[:, 2]], axis=1), rows)
        return np.column_stack([d, vu])


def locate_in_columns(
    chart: Topography, points: Floats, voxel_um: float, progress: Progress
) -> Floats:
    """(d µm, v, u) of points (n, 3) in µm, NaN where no column reaches."""
    locator = TopographyLocator(chart.nodes, chart.d_um, voxel_um)
    image, _ = locator.locate(points, progress)
    grid = to_grid(image, chart.d_um, chart.shape[1])
    image[~in_columns(grid, chart.first_layer, chart.last_layer)] = np.nan
    return image


def topography_to_world(chart: Topography, points: Floats) -> tuple[Floats, Any]:
    """Positions (n, 3) in µm of points (d µm, v, u), and whether they are in the space."""
    grid = to_grid(points, chart.d_um, chart.shape[1])
    valid = in_columns(grid, chart.first_layer, chart.last_layer)
    world = evaluate(chart.nodes, np.where(valid[:, None], grid, 0.0))
    world[~valid] = np.nan
    return world, valid


def to_grid(points: Floats, d_um: Floats, rows: int) -> Floats:
    """Grid coordinates (layer, row, column) of points (d µm, v, u)."""
    vu = wrap_uv(points[:, 1:], rows)
    layer = (points[:, 0] - d_um[0]) / (d_um[1] - d_um[0])
    return np.column_stack([layer, rows_from_v(vu[:, 0], rows), np.mod(vu[:, 1], 2.0 * rows)])
