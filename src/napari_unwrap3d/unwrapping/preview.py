"""Shapes to look at while a slider moves, before the step itself is computed anew.

The smoothing flow is run once and every iteration of it is kept; between two states of the
sphere every vertex goes along the great circle through them. Neither is the result of a
step: the reference is meshed anew, and a blend is relaxed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..charts import Floats, SealedSurface
from ..errors import ParameterError
from ..geometry.laplacian import vertex_mass
from ..geometry.mesh import signed_volume
from ..parameters import ReferenceParameters
from ..progress import Progress
from .cortex_fit import fit_to
from .flow import curvature_flow
from .reference import coarsened, plugged_surface

PREVIEW_VERTICES = 30_000
# Iterations kept beyond the one at which the flow stopped, and the least number of them.
BEYOND, LEAST = 10, 20


@dataclass(frozen=True, eq=False)
class FlowPreview:
    """The surface at every iteration of the smoothing flow.

    Attributes
    ----------
    faces : ndarray, (m, 3) int32
    frames : ndarray, (t + 1, n, 3) float32
        Vertices (z, y, x) in µm at iterations 0..t, each laid onto the cell as the
        reference is.
    """

    faces: npt.NDArray[np.int32]
    frames: npt.NDArray[np.float32]

    def at(self, iteration: int) -> npt.NDArray[np.float32]:
        """Vertices (n, 3) at an iteration; after the last kept one, at that."""
        vertices: npt.NDArray[np.float32] = self.frames[min(iteration, len(self.frames) - 1)]
        return vertices


def iterations_to_keep(parameters: ReferenceParameters, stopped_at: int) -> int:
    """How many iterations are worth keeping once the flow has stopped at one."""
    most = max(stopped_at + BEYOND, LEAST)
    if parameters.stop == "fixed":
        most = max(most, parameters.fixed_iteration + BEYOND)
    return most


def flow_preview(
    sealed: SealedSurface,
    parameters: ReferenceParameters,
    iterations: int,
    progress: Progress,
    vertices: int = PREVIEW_VERTICES,
) -> FlowPreview:
    """Run the flow of Step 1 and keep every iteration.

    Parameters
    ----------
    sealed : SealedSurface
        With its mask.
    parameters : ReferenceParameters
        Those of the flow itself are used, its stopping rule is not.
    iterations : int
        How many to keep; fewer where the flow breaks down.
    progress : Progress
    vertices : int
        A finer mesh is made as coarse as this.

    Raises
    ------
    ParameterError
        The sealed surface has no mask.
    MeshError
        The flow breaks down at its first iteration.
    """
    if sealed.mask is None:
        raise ParameterError("The sealed surface has no mask.", hint="Make it with seal().")
    start, faces = coarsened(*plugged_surface(sealed), progress.part(0.0, 0.1), most=vertices)
    fixed = {
        "stop": "fixed",
        "fixed_iteration": iterations,
        "iterations": iterations,
        "extra_iterations": 0,
    }
    frames = [start.astype(np.float32)]
    mass = vertex_mass(start, faces)

    def keep(moved: Floats) -> None:
        scale = None
        if parameters.keep_volume:
            scale = float(np.cbrt(signed_volume(start, faces) / signed_volume(moved, faces)))
        frames.append(fit_to(moved, start, mass, scale=scale).astype(np.float32))

    flowing = parameters.model_copy(update=fixed)
    curvature_flow(start, faces, flowing, progress.part(0.1, 1.0), on_iteration=keep)
    return FlowPreview(faces.astype(np.int32), np.stack(frames))


def between_blends(states: Mapping[float, Floats], blend: float) -> Floats:
    """Directions at a blend, from the two known states next to it.

    Parameters
    ----------
    states : mapping of float to ndarray, (n, 3)
        Unit vectors by blend, at least two, of the same vertices.
    blend : float
        Beyond the last known state the great circles go on.

    Returns
    -------
    ndarray, (n, 3)
        Unit vectors, in the type of the states.
    """
    known = sorted(states)
    if len(known) < 2:
        raise ParameterError("Two states are needed to go from one to the other.", states=known)
    upper = int(np.clip(np.searchsorted(known, blend), 1, len(known) - 1))
    low, high = known[upper - 1], known[upper]
    return along_great_circles(states[low], states[high], (blend - low) / (high - low))


def along_great_circles(start: Floats, stop: Floats, part: float) -> Floats:
    """Unit vectors (n, 3) at a part of the way from `start` (0) to `stop` (1)."""
    cosine = np.clip(np.einsum("ij,ij->i", start, stop), -1.0, 1.0)
    angle = np.arccos(cosine)
    sine = np.sin(angle)
    # Where both agree there is no circle, and nothing to move.
    far = sine > 1e-6
    safe = np.where(far, sine, 1.0)
    first = np.where(far, np.sin((1.0 - part) * angle) / safe, 1.0 - part)
    second = np.where(far, np.sin(part * angle) / safe, part)
    moved = first[:, None] * start + second[:, None] * stop
    moved /= np.linalg.norm(moved, axis=1, keepdims=True)
    directions: Floats = moved.astype(start.dtype, copy=False)
    return directions
