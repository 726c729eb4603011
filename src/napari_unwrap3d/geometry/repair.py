"""Repair a mesh so that it is one closed manifold, and say what was done.

A mesh that is closed and manifold keeps its vertices and faces; only its winding and
its smaller components can change. Everything else is repaired step by step, each step
counted in the report; what cannot be repaired without inventing surface is an error.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse import csgraph
from scipy.spatial import KDTree

from ..errors import MeshError, NotManifoldError, NotWatertightError, SeveralCellsError
from .cutting import cut_apart, dangling_faces
from .holes import fill_holes
from .mesh import (
    Floats,
    Ints,
    connected_components,
    degenerate_faces,
    edges_with_faces,
    face_areas,
    mesh_report,
    nonmanifold_vertices,
    orient_outward,
    radius_ratio,
    signed_volume,
    wind_consistently,
)

# Vertices closer than this fraction of the bounding box's diagonal are one vertex.
MERGE_TOLERANCE = 1e-8
LARGEST_HOLE = 0.05
TURNING_ROUNDS = 20
# So many vertices of a component say whether it lies inside another one.
SAMPLED_VERTICES = 100


@dataclass(frozen=True)
class Repaired:
    """A repaired mesh.

    Attributes
    ----------
    vertices : ndarray, (n, 3) float64
    faces : ndarray, (m, 3) int64
    origin : ndarray, (n,) int64
        The vertex of the input that each vertex comes from, or stands for.
    report : dict
        The measures of :func:`~napari_unwrap3d.geometry.mesh.mesh_report` after the
        repair; ``repairs``, a list of ``{"what", "count", ...}`` in the order they were
        made; and ``as_given``, the measures before.
    """

    vertices: Floats
    faces: Ints
    origin: Ints
    report: dict[str, Any]


class _Work:
    """A mesh under repair: its arrays, where its vertices came from, what was done."""

    def __init__(self, vertices: Floats, faces: Ints) -> None:
        self.vertices = vertices
        self.faces = faces
        self.origin = np.arange(len(vertices))
        self.without_face = len(vertices) - len(np.unique(faces))
        self.done: list[dict[str, Any]] = []

    def note(self, count: int, what: str, **numbers: Any) -> None:
        if count:
            self.done.append({"what": what, "count": int(count), **numbers})

    def keep_faces(self, keep: npt.NDArray[np.bool_], what: str, **numbers: Any) -> None:
        if not keep.any():
            raise MeshError(
                "Nothing is left of the mesh after repair.",
                faces=len(keep),
                hint="Its faces are all degenerate or doubled; check how it was made.",
            )
        self.faces = self.faces[keep]
        self.note(int((~keep).sum()), what, **numbers)

    def add_vertices(self, vertices: Floats, origin: Ints) -> None:
        self.vertices = vertices
        self.origin = np.concatenate([self.origin, self.origin[origin]])


def repair(
    vertices: npt.ArrayLike,
    faces: npt.ArrayLike,
    *,
    second_cell_fraction: float = 0.5,
    largest_hole: float = LARGEST_HOLE,
) -> tuple[Floats, Ints, dict[str, Any]]:
    """:func:`repair_mesh` as plain arrays: vertices (n, 3), faces (m, 3) and the report."""
    result = repair_mesh(
        vertices, faces, second_cell_fraction=second_cell_fraction, largest_hole=largest_hole
    )
    return result.vertices, result.faces, result.report


def repair_mesh(
    vertices: npt.ArrayLike,
    faces: npt.ArrayLike,
    *,
    second_cell_fraction: float = 0.5,
    largest_hole: float = LARGEST_HOLE,
) -> Repaired:
    """Make a mesh one closed, outward manifold.

    In order: merge vertices at the same place; drop faces with repeated vertices and
    doubled faces; drop sheets that hang on the surface by branching edges; keep the
    largest component; cut where sheets meet in an edge or vertex; close small holes;
    turn edges of faces without area; wind outwards; drop vertices without faces.

    Parameters
    ----------
    vertices : ndarray, (n, 3)
        In µm.
    faces : ndarray, (m, 3)
    second_cell_fraction : float
        Refuse when a second component has at least this fraction of the largest area.
    largest_hole : float
        Close holes up to this fraction of the area.

    Raises
    ------
    SeveralCellsError
        Two components of comparable size, neither inside the other.
    NotWatertightError
        A hole is too large.
    NotManifoldError
        The mesh is one-sided, or branches in a way that cannot be cut apart.
    MeshError
        Nothing is left, or the mesh encloses no volume.
    """
    work = _Work(np.array(vertices, dtype=np.float64), np.array(faces, dtype=np.int64))
    given = mesh_report(work.vertices, work.faces)
    if not _is_closed_manifold(work, given):
        _merge_vertices(work)
        _drop_bad_faces(work)
        _drop_dangling(work)
        _keep_largest(work, second_cell_fraction)
        _cut(work)
        _keep_largest(work, second_cell_fraction)
        _fill(work, largest_hole)
    elif given["components"] > 1:
        _keep_largest(work, second_cell_fraction)
    _orient(work)
    _turn_flat_faces(work)
    _drop_unused_vertices(work)
    report = mesh_report(work.vertices, work.faces) if work.done else dict(given)
    _check(work, report)
    report["repairs"] = work.done
    report["as_given"] = given
    return Repaired(work.vertices, work.faces, work.origin, report)


def _is_closed_manifold(work: _Work, report: dict[str, Any]) -> bool:
    """Whether the mesh is sound as it is; two corners of a face in one place are not."""
    if not report["watertight"] or report["nonmanifold_vertices"]:
        return False
    a, b, c = (work.vertices[corner] for corner in work.faces.T)
    pairs = ((a, b), (b, c), (c, a))
    return not any((p == q).all(axis=1).any() for p, q in pairs)


def _merge_vertices(work: _Work) -> None:
    order = np.lexsort(work.vertices.T)
    ordered = work.vertices[order]
    new = np.concatenate([[True], (ordered[1:] != ordered[:-1]).any(axis=1)])
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.cumsum(new) - 1
    distinct = ordered[new]
    diagonal = float(np.linalg.norm(np.ptp(distinct, axis=0)))
    near = KDTree(distinct).query_pairs(MERGE_TOLERANCE * diagonal, output_type="ndarray")
    links = sparse.coo_array((np.ones(len(near), np.int8), near.T), (len(distinct),) * 2)
    _, group = csgraph.connected_components(links, directed=False)
    label = group[place]
    first = np.full(int(label.max()) + 1, len(label))
    np.minimum.at(first, label, np.arange(len(label)))
    used = np.bincount(work.faces.ravel(), minlength=len(label)) > 0
    work.faces = first[label][work.faces]
    moved = used & (first[label] != np.arange(len(label)))
    work.note(int(moved.sum()), "vertices at the place of another one were merged with it")


def _drop_bad_faces(work: _Work) -> None:
    a, b, c = work.faces.T
    work.keep_faces((a != b) & (b != c) & (c != a), "faces with a repeated vertex were dropped")
    work.keep_faces(_one_of_each(work.faces), "doubled faces were dropped")


def _one_of_each(faces: Ints) -> npt.NDArray[np.bool_]:
    """Keep one of the copies of a face; none where as many run one way as the other.

    A pair of opposite faces encloses nothing, like the two sides of a sheet of paper.
    """
    ordered = np.sort(faces, axis=1)
    order = np.lexsort(ordered.T)
    new = (np.diff(ordered[order], axis=0) != 0).any(axis=1)
    same = np.empty(len(faces), dtype=np.int64)
    same[order] = np.concatenate([[0], np.cumsum(new)])
    a, b, c = faces.T
    even = ((a < b) & (b < c)) | ((b < c) & (c < a)) | ((c < a) & (a < b))
    net = np.bincount(same, np.where(even, 1, -1))[same]
    right_way = (net > 0) == even
    keep = np.zeros(len(faces), dtype=bool)
    candidates = np.flatnonzero((net != 0) & right_way)
    keep[candidates[np.unique(same[candidates], return_index=True)[1]]] = True
    return keep


def _drop_dangling(work: _Work) -> None:
    while (edges_with_faces(work.faces).valence > 2).any():
        dangling = dangling_faces(work.vertices, work.faces)
        if not dangling.any():
            return
        area = float(face_areas(work.vertices, work.faces[dangling]).sum())
        work.keep_faces(
            ~dangling, "faces of sheets hanging on the surface were dropped", area_um2=area
        )


def _keep_largest(work: _Work, second_cell_fraction: float) -> None:
    of_face, _ = connected_components(work.faces, len(work.vertices))
    area = np.bincount(of_face, face_areas(work.vertices, work.faces))
    order = np.argsort(area)[::-1]
    if len(area) == 1:
        return
    if area[order[1]] >= second_cell_fraction * area[order[0]]:
        walls = _walls_inside(work, of_face, int(order[0]))
        if walls.any():
            work.keep_faces(~walls, "faces of walls inside the cell, as of a cavity, were dropped")
            _keep_largest(work, second_cell_fraction)
            return
    if area[order[1]] >= second_cell_fraction * area[order[0]]:
        raise SeveralCellsError(
            "The mesh has two components of comparable size, so it may hold several cells.",
            components=len(area),
            largest_um2=float(area[order[0]]),
            second_um2=float(area[order[1]]),
            hint="Save each cell as a mesh of its own and open the one you mean.",
        )
    work.keep_faces(
        of_face == order[0],
        "faces of smaller components were dropped",
        components=len(area) - 1,
        area_um2=float(area[order[1:]].sum()),
    )


def _walls_inside(work: _Work, of_face: Ints, largest: int) -> npt.NDArray[np.bool_]:
    """Faces (m,) of the components that lie inside the largest one, where that is closed."""
    import igl

    inside = np.zeros(int(of_face.max()) + 1, dtype=bool)
    outer = work.faces[of_face == largest]
    if not (edges_with_faces(outer).valence == 2).all():
        return inside[of_face]
    outer = orient_outward(work.vertices, outer)
    for part in range(len(inside)):
        if part != largest:
            corners = np.unique(work.faces[of_face == part])
            some = corners[:: -(-len(corners) // SAMPLED_VERTICES)]
            winding = igl.winding_number(work.vertices, outer, work.vertices[some])
            inside[part] = bool((np.asarray(winding) > 0.5).all())
    return inside[of_face]


def _cut(work: _Work) -> None:
    wound = wind_consistently(work.faces)
    turned = int((wound != work.faces).any(axis=1).sum())
    work.note(turned, "faces were turned over to agree with their neighbours")
    work.faces = wound
    branching = int((edges_with_faces(work.faces).valence > 2).sum())
    if not branching and not len(nonmanifold_vertices(work.faces)):
        return
    vertices, faces, origin = cut_apart(work.vertices, work.faces)
    work.faces = wind_consistently(faces)
    work.add_vertices(vertices, origin)
    work.note(branching, "edges with more than two faces were cut apart")
    work.note(len(origin), "vertices were doubled where the surface met itself")


def _fill(work: _Work, largest_hole: float) -> None:
    vertices, faces, origin, counts = fill_holes(work.vertices, work.faces, largest_hole)
    work.faces = faces
    work.add_vertices(vertices, origin)
    work.note(
        int(counts["holes"]),
        "holes were closed",
        triangles=int(counts["triangles"]),
        area_um2=counts["area_um2"],
    )


def _turn_flat_faces(work: _Work) -> None:
    """Turn the longest edge of faces whose corners lie in line, by halves with a neighbour.

    Such a face has no normal and infinite cotangents. Its middle corner lies on the
    longest edge, so that turning this edge does not move the surface.
    """
    turned = 0
    for _ in range(TURNING_ROUNDS):
        flat = np.flatnonzero(degenerate_faces(work.vertices, work.faces))
        changed = _turn_once(work, flat)
        turned += changed
        if not changed:
            break
    work.note(turned, "edges of faces without area were turned")


def _turn_once(work: _Work, flat: Ints) -> int:
    edges = edges_with_faces(work.faces)
    stride = len(work.vertices)
    known = edges.vertices[:, 0] * stride + edges.vertices[:, 1]
    corners = work.vertices[work.faces[flat]]
    opposite = np.linalg.norm(np.roll(corners, -1, axis=1) - np.roll(corners, -2, axis=1), axis=2)
    touched: set[int] = set()
    turned = 0
    for face, k in zip(flat.tolist(), opposite.argmax(axis=1).tolist(), strict=True):
        start = edges.first[edges.of_face[face, k]]
        other, j = next(divmod(int(s), 3) for s in edges.slots[start : start + 2] if s // 3 != face)
        tip, b, c = (int(work.faces[face, (k + i) % 3]) for i in range(3))
        far = int(work.faces[other, j])
        key = min(tip, far) * stride + max(tip, far)
        at = int(np.searchsorted(known, key))
        exists = at < len(known) and known[at] == key
        pair = np.array([face, other])
        renewed = np.array([[tip, b, far], [tip, far, c]])
        before, after = (radius_ratio(work.vertices, f) for f in (work.faces[pair], renewed))
        if exists or {face, other, -1 - key} & touched or after.min() <= before.min():
            continue
        touched |= {face, other, -1 - key}
        work.faces[pair] = renewed
        turned += 1
    return turned


def _orient(work: _Work) -> None:
    oriented = orient_outward(work.vertices, work.faces)
    turned = (oriented != work.faces).any(axis=1)
    work.faces = oriented
    work.note(int(turned.sum()), "faces were turned over to point outwards")


def _drop_unused_vertices(work: _Work) -> None:
    used = np.bincount(work.faces.ravel(), minlength=len(work.vertices)) > 0
    name = np.cumsum(used) - 1
    work.faces = name[work.faces]
    work.vertices = work.vertices[used]
    work.origin = work.origin[used]
    work.note(work.without_face, "vertices without a face were dropped")


def _check(work: _Work, report: dict[str, Any]) -> None:
    hint = "Repair it in a mesh editor, or start from the mask or the stack instead."
    if report["nonmanifold_edges"] or report["nonmanifold_vertices"]:
        raise NotManifoldError(
            "The mesh branches in a way that cannot be cut apart.",
            nonmanifold_edges=report["nonmanifold_edges"],
            nonmanifold_vertices=report["nonmanifold_vertices"],
            hint=hint,
        )
    if not report["watertight"]:
        raise NotWatertightError(
            "The mesh is still open after repair.",
            boundary_edges=report["boundary_edges"],
            hint=hint,
        )
    volume = signed_volume(work.vertices, work.faces)
    if not volume > 1e-9 * report["area_um2"] ** 1.5:
        raise MeshError(
            "The mesh encloses no volume.",
            volume_um3=volume,
            area_um2=report["area_um2"],
            hint="A cell's surface is closed and not flat; check how the mesh was made.",
        )
