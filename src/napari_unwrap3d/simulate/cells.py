"""One simulated cell: the stack that a light-sheet microscope records, and the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from ..charts import Floats, Mask, Stack, Volume, check_voxel_size
from ..errors import ParameterError, Unwrap3DError
from ..progress import Progress, silent
from .bodies import Body
from .microscope import Microscope, fluorescence, image
from .protrusions import Shape
from .scenes import KINDS, NoRoom, Scene, clearance, draw_scene
from .solids import Solids, build, genus, smooth_noise

SMALLEST = 72
DRAWS = 20
BODY_SAMPLES = 15_000
LARGEST_ROUGHNESS = 0.6  # voxels; beyond, noise opens and closes gaps between shapes


@dataclass(frozen=True, eq=False)
class Truth:
    """What is known of a simulated cell.

    Attributes
    ----------
    mask : Mask
        The cell on the isotropic working grid.
    body : Mask
        The cell without its protrusions, and without the tunnels through it.
    labels : Volume, int32
        Protrusion k, counted from 1, in the voxels of `mask` outside of `body`; else 0.
    kinds : tuple of str
        Of each protrusion: "bleb", "lamellipodium", "filopodium" or "arch".
    heights_um : ndarray, (protrusions,)
        Largest distance of each protrusion's surface to the body's, as drawn (`roughness`
        comes on top); a tip within a neighbour counts as the neighbour's.
    genus : int
        Number of handles of the mask, the same with 6- and 26-connected voxels.
    handles_um : ndarray, (genus, 3)
        Where each handle is, as (z, y, x) in µm: the middle of a tunnel or a pinhole,
        the middle under an arch, or where two filopodia touch.
    """

    mask: Mask
    body: Mask
    labels: Volume
    kinds: tuple[str, ...]
    heights_um: Floats
    genus: int
    handles_um: Floats


@dataclass(frozen=True, eq=False)
class SimulatedCell:
    """A stack and its truth, in the same world coordinates.

    Attributes
    ----------
    stack : Stack
        ``zyx``, uint16 camera counts; voxel (0, 0, 0) is centred on the origin.
    truth : Truth
    kind : str
    seed : int
    microscope : Microscope
        How the stack was recorded.
    """

    stack: Stack
    truth: Truth
    kind: str
    seed: int
    microscope: Microscope


def cell(
    kind: str = "blebs",
    seed: int = 0,
    *,
    size: int = 200,
    voxel_size: tuple[float, float, float] = (0.3, 0.104, 0.104),
    working_voxel_um: float = 0.104,
    roughness: float = 0.0,
    microscope: Microscope | None = None,
    progress: Progress | None = None,
) -> SimulatedCell:
    """Simulate one cell and its recording.

    The same arguments give the same cell, bit for bit on one machine. The body is a lumpy
    ellipsoid of random aspect up to 1.6. The sizes below are for the default field of view
    of 20.8 µm and shrink with it; there may be fewer protrusions on a small cell.

    Parameters
    ----------
    kind : str
        ``"blebs"``: 20–35 round caps of radius 0.6–1.6 µm on necks.
        ``"lamellipodia"``: 3–6 curved, leaning sheets, 0.4–0.6 µm thick, 2–5 µm high.
        ``"filopodia"``: 15–25 bent tapered tubes, 2–6 µm long, of radius ≥ 0.25 µm.
        ``"touching_filopodia"``: the same, some fused with a neighbour: genus > 0.
        ``"handles"``: arches, thin tunnels through the body, sheets with pinholes, blebs.
        ``"mix"``: sheets, filopodia and blebs. All but two kinds have genus 0.
    seed : int
        Non-negative.
    size : int
        Edge of the cubic working grid in voxels; the cell fills it up to a margin of at
        least 8 voxels.
    voxel_size : (float, float, float)
        Of the stack, (z, y, x) in µm.
    working_voxel_um : float
        Of the truth, in µm.
    roughness : float
        Standard deviation in µm of a random displacement of the membrane that is smooth
        over 5 voxels; at most 0.6 of `working_voxel_um`.
    microscope : Microscope, optional
        Point-spread function, light, background and noise.
    progress : Progress, optional

    Raises
    ------
    ParameterError
        A parameter is unknown or out of its range.
    Unwrap3DError
        No cell of this kind was found (the grid is too coarse for it).
    """
    _check(kind, seed, size, working_voxel_um, roughness)
    stack_voxel = check_voxel_size(voxel_size)
    microscope = microscope or Microscope()
    report = progress or silent()
    scene, solids, handles, draw = _find(kind, seed, size, working_voxel_um, roughness, report)

    report(0.65, "Recording the stack")
    rng = np.random.default_rng([seed, KINDS.index(kind), draw, 1])
    nucleus = scene.body.centre, 0.5 * float(scene.body.semi_axes.min())
    texture = smooth_noise(rng, size, step=8)
    dye = report.run(fluorescence, solids.field, texture, working_voxel_um, nucleus)
    report(0.8, "Recording the stack")
    counts = report.run(image, dye, working_voxel_um, stack_voxel, microscope, rng)
    report(0.95, "Measuring the heights")

    voxel = (working_voxel_um,) * 3
    truth = Truth(
        mask=Mask(solids.mask, voxel),
        body=Mask(solids.body, voxel),
        labels=Volume(solids.labels, voxel),
        kinds=tuple(shape.kind for shape in scene.protrusions),
        heights_um=heights(scene.body, scene.protrusions),
        genus=handles,
        handles_um=np.reshape(scene.handles_um, (-1, 3)).astype(float),
    )
    report(1.0)
    stack = Stack(counts, "zyx", stack_voxel, name=f"{kind} {seed}")
    return SimulatedCell(stack, truth, kind, seed, microscope)


def heights(body: Body, protrusions: list[Shape]) -> Floats:
    """Largest distance (n,) in µm from each protrusion's free surface to the body's."""
    skin = body.samples(BODY_SAMPLES)
    tree = cKDTree(skin)
    tops = []
    for shape in protrusions:
        outside = body.level(shape.points) > 0
        points, radii = shape.points[outside], shape.radii[outside]
        distance, nearest = tree.query(points)
        outward = (points - skin[nearest]) / distance[:, None]
        # A tip within a neighbour is part of the neighbour.
        covered = _covered(points + radii[:, None] * outward, shape, protrusions)
        top = int(np.argmax(np.where(covered, -np.inf, distance + radii)))
        # To the plane that touches the body there, as the samples are some way apart.
        foot = skin[nearest[top]]
        tops.append(float((points[top] - foot) @ body.normals(foot) + radii[top]))
    return np.array(tops)


def _covered(points: Floats, shape: Shape, protrusions: list[Shape]) -> npt.NDArray[np.bool_]:
    """Which points (n, 3) of a shape's surface lie within another shape."""
    covered = np.zeros(len(points), bool)
    for other in protrusions:
        near = (shape.low < other.high).all() and (other.low < shape.high).all()
        if other is not shape and near and clearance(shape, other) < 0:
            apart = np.linalg.norm(points[:, None] - other.points, axis=2)
            covered |= (apart < other.radii).any(axis=1)
    return covered


def _find(
    kind: str, seed: int, size: int, voxel_um: float, roughness: float, report: Progress
) -> tuple[Scene, Solids, int, int]:
    """The first draw whose voxels have the topology that the scene was drawn for."""
    for draw in range(DRAWS):
        report(0.02, "Drawing the cell")
        rng = np.random.default_rng([seed, KINDS.index(kind), draw])
        try:
            scene = report.run(draw_scene, kind, rng, size, voxel_um, 4 * roughness)
        except NoRoom:
            continue
        displacement = None
        if roughness > 0:
            displacement = smooth_noise(rng, size) * np.float32(roughness)
        solids = build(
            scene.body,
            scene.protrusions,
            scene.holes,
            size,
            voxel_um,
            displacement,
            lambda fraction: report(0.1 + 0.4 * fraction, "Drawing the cell"),
        )
        handles = genus(solids.mask)
        if handles is not None and handles == len(scene.handles_um):
            return scene, solids, handles, draw
    raise Unwrap3DError(
        f"No cell of the kind {kind!r} was found that the grid resolves.",
        draws=DRAWS,
        size=size,
        roughness=roughness,
        hint="Use a larger size, a smaller working_voxel_um, or less roughness.",
    )


def _check(kind: str, seed: int, size: int, voxel_um: float, roughness: float) -> None:
    if kind not in KINDS:
        raise ParameterError(
            f"There is no kind of cell {kind!r}.", hint=f"Choose one of {', '.join(KINDS)}."
        )
    if seed < 0:
        raise ParameterError("The seed must not be negative.", seed=seed)
    if size < SMALLEST:
        raise ParameterError(
            "The grid is too small for a cell.", size=size, hint=f"Use size ≥ {SMALLEST}."
        )
    if not (np.isfinite(voxel_um) and voxel_um > 0):
        raise ParameterError("The working voxel must be positive.", working_voxel_um=voxel_um)
    largest = LARGEST_ROUGHNESS * voxel_um
    if not 0 <= roughness <= largest:
        raise ParameterError(
            "The roughness is out of its range.",
            roughness=roughness,
            hint=f"It is a length in µm between 0 and {largest:.3g}.",
        )
