"""Step 5 by active contour cMCF: the paper's other way to propagate the reference.

Every layer is the last one moved by α along the gradient of the signed distance, with the
stiffness of cMCF: ``(M_t − δ L_0) w = M_t ∇Φ`` and ``v(t + 1) = v(t) + α w / |w|``. The
stiffness acts on the displacement and not, as in the paper, on the position as well, where
it would also shrink the contour by its curvature, by more than α where the cell is small;
and w is scaled to unit length so that d stays an arc length.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import sparse

from ..charts import Floats, Ints
from ..geometry.interpolate import sample_linear
from ..geometry.laplacian import Factor, conjugate_gradient, cotangent_laplacian, vertex_mass
from ..geometry.robust_smooth import box_smooth, robust_smooth
from ..parameters import TopographyParameters
from ..progress import Progress
from .normal_field import NormalField

# A column ends where the signed distance is this flat: on the medial axis it has no gradient.
FLATTEST_GRADIENT = 0.2
BOX_PIXELS = 5
SOLVER_TOLERANCE = 1e-6
SOLVER_ITERATIONS = 15


def contour_nodes(
    field: NormalField,
    start: Floats,
    inward: int,
    outward: int,
    step: float,
    parameters: TopographyParameters,
    progress: Progress,
) -> tuple[npt.NDArray[np.float32], Ints]:
    """Propagate the reference both ways, a whole layer at a time.

    Parameters
    ----------
    start : ndarray, (N + 2, 2N, 3)
        In µm, on the reference; the first and the last row are the poles.
    inward, outward : int
        Numbers of layers.
    step : float
        α, arc length between layers in voxels.

    Returns
    -------
    nodes : ndarray, (inward + 1 + outward, N + 2, 2N, 3) float32
        Index coordinates of the field's grid.
    first_layer : ndarray, (N + 2, 2N) int64
        The deepest layer that each column reaches.
    """
    rows, columns = start.shape[0] - 2, start.shape[1]
    nodes = np.empty((inward + 1 + outward, rows + 2, columns, 3), np.float32)
    first_layer = np.zeros((rows + 2, columns), np.int64)
    origin = _without_copies(field.distance.to_index(start.reshape(-1, 3)).reshape(start.shape))
    nodes[inward] = _with_copies(origin, rows)
    contour = _Contour(field, origin, rows, parameters)
    for sign, count in ((1, outward), (-1, inward)):
        points = origin.copy()
        reached = np.full(len(points), count)
        begin = 0.0 if sign > 0 else outward / max(inward + outward, 1)
        for layer in range(1, count + 1):
            progress(begin + layer / max(inward + outward, 1) * 0.999, "moving the contour")
            moved = progress.run(contour.moved, points, sign * step)
            reached[(reached == count) & ~contour.may_go_on(points, sign)] = layer - 1
            going = reached >= layer
            points[going] = moved[going]
            nodes[inward + sign * layer] = _with_copies(points, rows)
        if sign < 0:
            first_layer[:] = inward - _with_copies(reached[:, None], rows)[..., 0]
    return nodes, first_layer


def automatic_step(positions: Floats, voxel_um: float) -> float:
    """α in voxels: half the mean sum of a pixel's steps in u and v, at most ½ (Datasets).

    Parameters
    ----------
    positions : ndarray, (N, 2N, 3)
        The reference's points in µm under the pixels.
    """
    along_u = np.linalg.norm(np.roll(positions, -1, axis=1) - positions, axis=-1).mean()
    along_v = np.linalg.norm(np.diff(positions, axis=0), axis=-1).mean()
    return float(min(0.5, 0.5 * (along_u + along_v) / voxel_um))


class _Contour:
    """The moving contour: the grid's triangles with their stiffness, and the force."""

    def __init__(
        self, field: NormalField, points: Floats, rows: int, parameters: TopographyParameters
    ) -> None:
        self._gradient = [np.ascontiguousarray(g) for g in np.gradient(field.distance.data)]
        self._core, self._core_radius = field.core, field.core_radius
        self._rows, self._kind = rows, parameters.contour_smoothing
        self._faces = grid_faces(rows)
        # δ belongs to a surface of unit area (paper, Step 1).
        area = vertex_mass(points, self._faces).sum()
        self._stiffness = parameters.contour_delta * cotangent_laplacian(points, self._faces)
        self._area = area
        self._factor: Factor | None = None
        self._s: float | None = None

    def force(self, points: Floats) -> Floats:
        """∇Φ (n, 3) at points, outward."""
        index = np.ascontiguousarray(points)
        return np.stack([sample_linear(g, index) for g in self._gradient], axis=1).astype(float)

    def may_go_on(self, points: Floats, sign: int) -> npt.NDArray[np.bool_]:
        """Whether the force at points (n, 3) leads anywhere."""
        if sign > 0:
            return np.ones(len(points), bool)
        steep = np.linalg.norm(self.force(points), axis=1) > FLATTEST_GRADIENT
        away = np.linalg.norm(points - self._core, axis=1) > self._core_radius
        return np.asarray(steep & away)

    def moved(self, points: Floats, step: float) -> Floats:
        """The contour's vertices (n, 3) one step on."""
        displacement = self._stiffened(points, _unit(self.force(points)))
        smooth = self._smoothed(displacement)
        result: Floats = points + step * _unit(smooth)
        return result

    def _stiffened(self, points: Floats, force: Floats) -> Floats:
        mass = np.maximum(vertex_mass(points, self._faces) / self._area, 1e-14)
        matrix = sparse.csr_array(sparse.diags_array(mass) - self._stiffness)
        right = mass[:, None] * force
        if self._factor is None:
            self._factor = Factor(matrix)
        solution, converged = conjugate_gradient(
            matrix,
            right,
            self._factor,
            tolerance=SOLVER_TOLERANCE,
            iterations=SOLVER_ITERATIONS,
        )
        if not converged:
            self._factor = Factor(matrix)
            solution = self._factor.solve(right)
        return solution

    def _smoothed(self, displacement: Floats) -> Floats:
        if self._kind == "none":
            return displacement
        image = displacement[1:-1].reshape(self._rows, 2 * self._rows, 3)
        if self._kind == "box":
            image = box_smooth(image, BOX_PIXELS)
        else:
            # How smooth is found once: the force is much the same from layer to layer.
            image, self._s = robust_smooth(image, self._s)
        ends = image[[0, -1]].mean(axis=1)
        return np.concatenate([ends[:1], image.reshape(-1, 3), ends[1:]])


def grid_faces(rows: int) -> Ints:
    """Triangles of the pixels of an N × 2N image and of the two poles, a closed sphere.

    Vertex 0 is the north pole, the last one the south pole; outward in (z, y, x).
    """
    columns = 2 * rows
    index = 1 + np.arange(rows * columns).reshape(rows, columns)
    a, b = index[:-1], np.roll(index, -1, axis=1)[:-1]
    c, d = index[1:], np.roll(index, -1, axis=1)[1:]
    inner = [np.stack([a, b, c], axis=-1), np.stack([b, d, c], axis=-1)]
    top, bottom = index[0], index[-1]
    south = 1 + rows * columns
    caps = [
        np.stack([np.zeros_like(top), np.roll(top, -1), top], axis=-1),
        np.stack([np.full_like(bottom, south), bottom, np.roll(bottom, -1)], axis=-1),
    ]
    return np.concatenate([part.reshape(-1, 3) for part in (*inner, *caps)])


def _unit(vectors: Floats) -> Floats:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    unit: Floats = vectors / np.maximum(length, 1e-12)
    return unit


def _without_copies(image: Floats) -> Floats:
    """Values (n, k) of a grid (N + 2, 2N, k) whose pole rows repeat one value."""
    inner = image[1:-1].reshape(-1, image.shape[-1])
    return np.concatenate([image[0, :1], inner, image[-1, :1]]).astype(np.float64)


def _with_copies(values: npt.NDArray[np.generic], rows: int) -> npt.NDArray[np.generic]:
    """The grid (N + 2, 2N, k) of values (n, k)."""
    columns = 2 * rows
    inner = values[1:-1].reshape(rows, columns, -1)
    ends = [np.broadcast_to(values[i], (1, columns, inner.shape[2])) for i in (0, -1)]
    return np.concatenate([ends[0], inner, ends[1]])
