"""Step 1: the smooth genus-0 reference under the protrusions.

The sealed surface flows until its protrusions are gone, is voxelised, made a topological
ball, meshed and remeshed.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ..charts import Floats, Ints, Mask, Reference, SealedSurface, Volume
from ..errors import NotGenusZeroError
from ..geometry.curvature import mean_curvature, total_absolute_curvature
from ..geometry.distance import distance_to, signed_distance
from ..geometry.laplacian import vertex_mass
from ..geometry.marching import clamped_marching_cubes, field_with_sign
from ..geometry.mesh import euler_characteristic, is_watertight, signed_volume
from ..geometry.remesh import level_set_projection, relax, simplify, subdivide
from ..geometry.smoothing import smooth_keeping_volume
from ..geometry.topology import box_around, largest_part, seal
from ..geometry.topology import euler_characteristic as solid_euler_characteristic
from ..geometry.voxelize import voxelize
from ..parameters import ReferenceParameters
from ..progress import Progress
from .cortex import cortex_depth
from .cortex_fit import fit_to, fit_to_cortex
from .flow import Flow, curvature_flow

# The flow smooths over many edges of a fine mesh: it loses nothing on a coarser one.
FLOW_VERTICES = 40_000
BORDER_VOXELS = 6
PLUG_FRACTION = 0.25
PLUG_DEPTH_FRACTION = 0.6
SMALLEST_PLUG_VOXELS = 2.0
# The reference is smooth; what is finer than this in its curvature are its voxels.
CURVATURE_SMOOTHING_VOXELS = 4.0
SPIKE_RADIUS_VOXELS = 3.0
# What is nearer to the cell's surface than about this is on its cortex.
CORTEX_REACH_VOXELS = 1.0


def reference(
    sealed: SealedSurface, parameters: ReferenceParameters, progress: Progress
) -> Reference:
    """Make the reference of a sealed surface (paper, Step 1).

    It may be the sealed surface itself, whatever was sealed, meshed again or as it is.

    Parameters
    ----------
    sealed : SealedSurface
        Genus 0, with its mask on the isotropic working grid.
    parameters : ReferenceParameters
    progress : Progress

    Returns
    -------
    Reference
        Watertight, one component, χ = 2.

    Raises
    ------
    NotGenusZeroError
        The mesh of the reference is not a topological sphere.
    """
    if sealed.mask is None:
        raise NotGenusZeroError("The sealed surface has no mask.", hint="Make it with seal().")
    mask = _with_border(sealed.mask)
    level = None
    if parameters.skip:
        curve = np.array([total_absolute_curvature(sealed.vertices, sealed.faces)])
        solid, flow = mask.data, Flow(sealed.vertices, 0, curve, "skipped")
    elif parameters.method != "flow":
        curve = np.array([total_absolute_curvature(sealed.vertices, sealed.faces)])
        solid, level = opened_cell(sealed, parameters, progress)
        flow = Flow(sealed.vertices, 0, curve, parameters.method)
    else:
        solid, flow = smoothed_solid(sealed, mask, parameters, progress)
    progress(0.72, "meshing the reference")
    if level is None:
        level = level_function(solid, parameters.smoothing_voxels)
    if parameters.skip and parameters.keep_mesh:
        vertices, faces = sealed.vertices, sealed.faces
    else:
        index, faces = mesh_level(level, parameters.vertices, progress.part(0.75, 0.95))
        if parameters.mesh_smoothing:
            index = smooth_keeping_volume(
                index, faces, progress.part(0.95, 1.0), iterations=parameters.mesh_smoothing
            )
        vertices = mask.to_world(index)
    chi = euler_characteristic(faces)
    if chi != 2 or not is_watertight(faces):
        raise NotGenusZeroError(
            "The reference is not a topological sphere.",
            euler_characteristic=chi,
            hint="Smooth more (a later stop of the flow), or choose a smaller working voxel.",
        )
    # As far as the Gaussian (which scipy cuts off at 4 σ) and two differences reach.
    box = box_around(solid, int(4.0 * CURVATURE_SMOOTHING_VOXELS) + 4)
    corner = np.array([side.start for side in box])
    curvature = mean_curvature(
        signed_distance(solid[box]),
        mask.to_index(vertices) - corner,
        smoothing=CURVATURE_SMOOTHING_VOXELS,
    )
    return Reference(
        vertices=vertices,
        faces=faces,
        fields={"mean_curvature_per_um": curvature / mask.voxel_size[0]},
        mask=Mask(solid, mask.voxel_size, mask.origin),
        level=Volume(level, mask.voxel_size, mask.origin),
        iteration=flow.iteration,
        total_curvature=flow.total_curvature,
        stopped_by=flow.stopped_by,
    )


def smoothed_solid(
    sealed: SealedSurface, grid: Mask, parameters: ReferenceParameters, progress: Progress
) -> tuple[npt.NDArray[np.bool_], Flow]:
    """The flowed surface where it came from, as a topological ball on the grid."""
    assert sealed.mask is not None
    start, faces = coarsened(*plugged_surface(sealed), progress.part(0.0, 0.05))
    # The paper's mean is over the vertices of the surface itself, not of the coarser one.
    flow = curvature_flow(
        start, faces, parameters, progress.part(0.05, 0.6), mean_over=len(sealed.vertices)
    )
    scale = None
    if parameters.keep_volume:
        scale = float(np.cbrt(signed_volume(start, faces) / signed_volume(flow.vertices, faces)))
    placed = fit_to(flow.vertices, start, vertex_mass(start, faces), scale=scale)
    if scale is None:
        placed = progress.run(
            fit_to_cortex, placed, start, faces, CORTEX_REACH_VOXELS * grid.voxel_size[0]
        )
    progress(0.62, "voxelising the reference")
    inside = voxelize(grid.to_index(placed), faces, grid.shape)
    return seal(without_spikes(largest_part(inside))), flow


def opened_cell(
    sealed: SealedSurface, parameters: ReferenceParameters, progress: Progress
) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.float32]]:
    """The cell opened by a ball as a topological ball, on the grid with a border, and its level."""
    assert sealed.mask is not None
    plugs = plugged(sealed, sealed.mask)
    solid = np.pad(sealed.mask.data if plugs is None else plugs, BORDER_VOXELS)
    twice = parameters.method == "second_cortex"
    level = cortex_depth(solid, parameters.cortex_radius, twice, progress.part(0.0, 0.6))
    closed = level > 0
    if plugs is not None:  # what closes a hole stays, however thin
        closed |= np.pad(plugs & ~sealed.mask.data, BORDER_VOXELS)
    progress(0.62, "making the cortex a ball")
    ball = seal(largest_part(closed))
    smooth = ndimage.gaussian_filter(level, parameters.smoothing_voxels)
    return ball, field_with_sign(smooth, ball)


def plugged_surface(sealed: SealedSurface) -> tuple[Floats, Ints]:
    """The sealed surface, or that of its :func:`plugged` solid where there is one."""
    assert sealed.mask is not None
    plugs = plugged(sealed, sealed.mask)
    if plugs is None:
        return sealed.vertices, sealed.faces
    vertices, faces = clamped_marching_cubes(level_function(plugs, 1.0))
    return sealed.mask.to_world(vertices), faces


def plugged(sealed: SealedSurface, mask: Mask) -> npt.NDArray[np.bool_] | None:
    """The sealed solid with its membranes and cuts as thick as the shape around them.

    A membrane of one voxel would stay a crease in the reference, into which no normals
    lead, and a slit of one voxel would close; a plug and a gap smooth away. None where
    nothing of any size was sealed.
    """
    solid = mask.data
    deepest = float(distance_to(~solid).max())
    plugs = _thickened(sealed.membranes, deepest)
    gaps = _thickened(sealed.cuts, deepest)
    if plugs is None and gaps is None:
        return None
    if plugs is not None:
        solid = solid | plugs
    if gaps is not None:
        opened = largest_part(solid & ~gaps)
        # Nothing but the gap may be lost: a gap must not cut off an arm.
        if (solid & ~opened & ~gaps).sum() <= gaps.sum():
            solid = opened
    return seal(solid)


def _thickened(sheets: Mask | None, deepest: float) -> npt.NDArray[np.bool_] | None:
    """Sheets of voxels made as thick as their size asks for; None if all are tiny."""
    if sheets is None:
        return None
    labels, _ = ndimage.label(sheets.data, structure=np.ones((3, 3, 3)))
    thick_sheets = np.zeros(labels.shape, bool)
    for part, box in enumerate(ndimage.find_objects(labels), start=1):
        radius = np.sqrt((labels[box] == part).sum() / np.pi)
        if radius < SMALLEST_PLUG_VOXELS:
            continue
        thick = min(PLUG_FRACTION * radius, PLUG_DEPTH_FRACTION * deepest)
        pad = int(np.ceil(thick)) + 1
        wide = tuple(
            slice(max(b.start - pad, 0), min(b.stop + pad, n))
            for b, n in zip(box, labels.shape, strict=True)
        )
        thick_sheets[wide] |= distance_to(labels[wide] == part) <= thick
    return thick_sheets if thick_sheets.any() else None


def coarsened(
    vertices: Floats, faces: Ints, progress: Progress, most: int | None = None
) -> tuple[Floats, Ints]:
    """The mesh with at most so many vertices, if that keeps it a closed sphere."""
    most = FLOW_VERTICES if most is None else most
    if len(vertices) <= most:
        return vertices, faces
    fewer, triangles = simplify(vertices, faces, most)
    if euler_characteristic(triangles) != 2 or not is_watertight(triangles):
        return vertices, faces
    return relax(fewer, triangles, progress, iterations=3)


def without_spikes(solid: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Opening by a small ball: spikes that the flow draws out of long arms are cut off.

    What closes a hole stays, however thin; a solid that would lose more than a tenth is
    thin all over and is left as it is.
    """
    if not solid.any():
        return solid
    # Within its box, with a border of background, the solid has the same distances.
    box = box_around(solid, 1)
    core = distance_to(~solid[box]) > SPIKE_RADIUS_VOXELS
    if not core.any():
        return solid
    opened = np.zeros_like(solid)
    opened[box] = largest_part(solid[box] & (distance_to(core) <= SPIKE_RADIUS_VOXELS))
    if opened.sum() <= 0.9 * solid.sum():
        return solid
    if solid_euler_characteristic(opened) == 1:
        return opened
    lost, _ = ndimage.label(solid & ~opened, structure=np.ones((3, 3, 3)))
    plugs = np.unique(lost[seal(opened) & ~opened])
    kept: npt.NDArray[np.bool_] = opened | np.isin(lost, plugs[plugs > 0])
    return kept


def level_function(solid: npt.NDArray[np.bool_], smoothing: float) -> npt.NDArray[np.float32]:
    """Smoothed solid minus ½, its sign forced to agree with the solid."""
    values = solid.astype(np.float32)
    smooth = ndimage.gaussian_filter(values, smoothing) if smoothing else values
    return field_with_sign(smooth - np.float32(0.5), solid)


def mesh_level(
    level: npt.NDArray[np.float32], target: int, progress: Progress
) -> tuple[Floats, Ints]:
    """Near-equilateral mesh of the zero set, in index coordinates, topology kept.

    Every cell gets the same number of vertices, a small one by subdivision: the maps, and
    labels carried through them, are as fine as this mesh.
    """
    vertices, faces = clamped_marching_cubes(level)
    while len(vertices) < target:
        vertices, faces = subdivide(vertices, faces)
    fewer, triangles = progress.run(simplify, vertices, faces, target)
    if euler_characteristic(triangles) == euler_characteristic(faces) and is_watertight(triangles):
        vertices, faces = fewer, triangles
    project = level_set_projection(ndimage.gaussian_filter(level, 0.5))
    return relax(vertices, faces, progress, project=project)


def _with_border(mask: Mask) -> Mask:
    """The grid with room around it: where the cell fills it, the flow may lead outside."""
    z, y, x = (o - BORDER_VOXELS * s for o, s in zip(mask.origin, mask.voxel_size, strict=True))
    return Mask(np.pad(mask.data, BORDER_VOXELS), mask.voxel_size, (z, y, x))
