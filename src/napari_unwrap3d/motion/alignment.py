"""One atlas per timepoint: which place of one sphere is which of another (common = "each").

For cells that change shape too much for one space (paper, "Individual blebs dynamically recruit
Septins"). A guide, a coarse mesh of the chosen timepoint's smoothed solid of which every vertex
knows its place on the common sphere, is fitted to the smoothed solid of one timepoint after the
other. The sphere of a timepoint is then turned, and smoothly moved, to where its guide says that
the places of its reference are on the common one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy import ndimage

from ..atlas import Atlas
from ..charts import Floats, Ints, Mask, Reference, Sphere, Surface
from ..geometry.distortion import flipped_faces, mean_log_area_distortion
from ..geometry.fit import Target, fit_mesh
from ..geometry.laplacian import vertex_mass
from ..geometry.locate import SurfaceLocator, interpolate
from ..geometry.marching import clamped_marching_cubes
from ..geometry.mesh import is_watertight, unit, vertex_normals
from ..geometry.remesh import relax, simplify
from ..geometry.repair import repair
from ..geometry.spherical_alignment import angles, best_rotation, move_towards
from ..parameters import Parameters
from ..pipeline import Pipeline
from ..progress import Progress, silent
from ..unwrapping import measure
from ..unwrapping.surface import smooth_solid
from ..unwrapping.uv import uv_image

DIRECTION = "direction"
# What the areas of an aligned sphere are: those that the places have on the common one.
COMMON = "common"
GUIDE_VERTICES, TARGET_VERTICES = 1000, 3000
# Solids are smoothed by this part of the radius of the largest ball in them: what comes and goes
# on the cortex is not followed.
SMOOTHING = 0.05
# Places of the reference farther from the guide than so many voxels say little.
NEAR_VOXELS = 4.0


def smoothed_mesh(mask: Mask, vertices: int) -> tuple[Floats, Ints]:
    """A coarse mesh of a solid without its details: vertices (n, 3) in µm and faces (m, 3)."""
    deepest = float(ndimage.distance_transform_edt(mask.data).max())
    field, _ = smooth_solid(mask.data, SMOOTHING * deepest)
    index, faces = clamped_marching_cubes(field)
    points, fewer = simplify(index, faces, vertices)
    if not is_watertight(fewer):  # thin sheets are pinched where vertices are taken away
        points, fewer, _ = repair(points, fewer)
    points, fewer = relax(points, fewer, silent())
    return mask.to_world(points), fewer


def guide_of(mask: Mask, reference: Reference, sphere: Sphere) -> Surface:
    """The guide at the chosen timepoint, with every vertex's unit vector on the common sphere."""
    vertices, faces = smoothed_mesh(mask, GUIDE_VERTICES)
    place = SurfaceLocator(reference.vertices, reference.faces).closest(vertices)[:2]
    directions = unit(interpolate(sphere.vertices, sphere.faces, *place))
    return Surface(vertices, faces, {DIRECTION: directions})


def fitted(guide: Surface, mask: Mask, progress: Progress) -> Surface:
    """The guide brought from one timepoint to another.

    Parameters
    ----------
    guide : Surface
        At a timepoint near by, which is its shape without strain: how it has stretched until
        there is not undone.
    mask : Mask
        Of the timepoint that it is brought to.
    progress : Progress
    """
    target = Target.of(*smoothed_mesh(mask, TARGET_VERTICES))
    progress(0.1, "fitting the guide")
    vertices = fit_mesh(guide.vertices, guide.faces, target, progress.part(0.1, 1.0))
    return replace(guide, vertices=vertices)


def aligned(
    reference: Reference,
    sphere: Sphere,
    guide: Surface,
    common: Atlas,
    progress: Progress,
) -> tuple[Sphere, dict[str, Any]]:
    """Align the sphere of a timepoint with the common one.

    Parameters
    ----------
    reference, sphere
        The timepoint's own charts.
    guide : Surface
        At this timepoint.
    common : Atlas
        Of the chosen timepoint.
    progress : Progress

    Returns
    -------
    sphere : Sphere
        Both states are turned, the chosen one is also moved, without a flip.
    numbers : dict
        For ``quality["alignment"]``, JSON-able. Of the sphere as it came ("own"), turned
        ("rotated") and moved ("aligned"): how far its places are, on average by area, from where
        the guide puts them, as ``angle_*_rad`` on the sphere and ``residual_*_um`` on the common
        reference; of the latter two also the mean |log λ| against the timepoint's reference.
    """
    targets, trust = wanted_places(reference, guide, common.voxel_um)
    mass = vertex_mass(reference.vertices, reference.faces)
    rotation = best_rotation(sphere.vertices, targets, mass * trust)
    turned = unit(sphere.vertices @ rotation.T)
    part = progress.part(0.1, 0.9)
    moved = move_towards(turned, sphere.faces, targets, trust, part)
    conformal = unit(sphere.conformal @ rotation.T)
    chart = replace(sphere, vertices=moved, conformal=conformal, target=COMMON)
    progress(0.9, "measuring the alignment")
    stages = {"own": sphere.vertices, "rotated": turned, "aligned": moved}
    numbers: dict[str, Any] = {"flipped_faces": flipped_faces(moved, sphere.faces)}
    for name, directions in stages.items():
        far = _distances(common, directions, targets)
        numbers[f"residual_{name}_um"] = float(mass @ far / mass.sum())
        numbers[f"angle_{name}_rad"] = float(mass @ angles(directions, targets) / mass.sum())
    for name, directions in (("rotated", turned), ("aligned", moved)):
        numbers[f"mean_abs_log_lambda_{name}"] = mean_log_area_distortion(
            reference.vertices, directions, sphere.faces
        )
    return chart, numbers


def aligned_atlas(
    source: Mask | Surface,
    guide: Surface,
    common: Atlas,
    parameters: Parameters,
    report: Callable[[str, float, str], None],
) -> Atlas:
    """Unwrap a timepoint by itself, on a sphere that is aligned with the common one.

    Parameters
    ----------
    source : Mask or Surface
        Of the timepoint.
    guide : Surface
        At this timepoint.
    common : Atlas
        Of the chosen timepoint, whose unwrapping rotation holds for all.
    parameters : Parameters
    report : callable(step, fraction, message)
    """
    pipeline = Pipeline(source)
    own = pipeline.run(parameters, report, until="sphere")
    progress = Progress(report, "sphere")
    sphere, found = aligned(own.reference, own.sphere, guide, common, progress)
    numbers = measure.measure_sphere(own.reference, sphere)
    pipeline.provide("sphere", sphere, numbers, parameters)
    rotation, rows = common.uv.rotation, parameters.uv.rows
    image = uv_image(own.reference, sphere, rotation, rows, progress.named("uv"))
    numbers = measure.measure_uv(own.reference, image)
    pipeline.provide("uv", image, numbers, parameters)
    atlas = pipeline.run(parameters, report)
    return atlas.replaced(quality={**atlas.quality, "alignment": found})


def wanted_places(reference: Reference, guide: Surface, voxel_um: float) -> tuple[Floats, Floats]:
    """Unit vectors (n, 3) on the common sphere of a reference's vertices, and trust (n,) 0 … 1."""
    locator = SurfaceLocator(guide.vertices, guide.faces)
    face, weights, distance = locator.closest(reference.vertices)
    targets = unit(interpolate(guide.fields[DIRECTION], guide.faces, face, weights))
    normals = vertex_normals(reference.vertices, reference.faces)
    there = interpolate(vertex_normals(guide.vertices, guide.faces), guide.faces, face, weights)
    facing = np.maximum(np.einsum("ij,ij->i", normals, there), 0.0)
    # Smoothing puts the guide as a whole inside or outside: what is farther than most counts.
    limit = max(NEAR_VOXELS * voxel_um, 2.0 * float(np.median(distance)))
    return targets, facing**2 / (1.0 + (distance / limit) ** 2)


def _distances(common: Atlas, one: Floats, other: Floats) -> Floats:
    """µm (n,) between the places of the common reference at unit vectors (n, 3)."""
    (first, _), (second, _) = (common.map(each, "sphere", "reference") for each in (one, other))
    far: Floats = np.linalg.norm(first - second, axis=1)
    return far


def in_order(timepoints: Sequence[int], chosen: int) -> Iterator[tuple[int, int]]:
    """(timepoint, its neighbour on the way to the chosen one), nearest to the chosen one first.

    Of some timepoints in their order, the chosen one among them.
    """
    at = list(timepoints).index(chosen)
    yield from _later(timepoints[at:])
    yield from _later(timepoints[at::-1])


def _later(timepoints: Sequence[int]) -> Iterator[tuple[int, int]]:
    """Each timepoint after the first, and the one before it."""
    return zip(timepoints[1:], timepoints, strict=False)
