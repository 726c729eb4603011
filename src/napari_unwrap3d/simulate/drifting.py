"""How a cell drifts and turns under the microscope: a smooth random walk."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from ..charts import Floats
from ..geometry.rigid import Rigid

SMOOTH_TIMEPOINTS = 4.0


def draw_poses(
    rng: np.random.Generator, timepoints: int, centre: Floats, drift_um: float, rotation_deg: float
) -> tuple[Rigid, ...]:
    """Where the cell lies at every timepoint: from its own world to the microscope's.

    Parameters
    ----------
    rng : numpy.random.Generator
    timepoints : int
    centre : ndarray, (3,)
        The point (z, y, x) in µm about which the cell turns.
    drift_um : float
        Largest shift along an axis.
    rotation_deg : float
        Largest angle.

    Returns
    -------
    tuple of Rigid
        The first is the identity.
    """
    from scipy.spatial.transform import Rotation

    shifts = _walk(rng, timepoints)
    shifts *= drift_um / max(float(np.abs(shifts).max()), 1e-9)
    turns = _walk(rng, timepoints)
    turns *= np.radians(rotation_deg) / max(float(np.linalg.norm(turns, axis=1).max()), 1e-9)
    rotations = Rotation.from_rotvec(turns).as_matrix()
    return tuple(
        Rigid.about(centre, turn, shift) for turn, shift in zip(rotations, shifts, strict=True)
    )


def _walk(rng: np.random.Generator, timepoints: int) -> Floats:
    """A smooth random walk (timepoints, 3) from 0."""
    steps = rng.normal(size=(timepoints, 3))
    steps = ndimage.gaussian_filter1d(steps, SMOOTH_TIMEPOINTS, axis=0, mode="reflect")
    walk = np.cumsum(steps, axis=0)
    start_at_rest: Floats = walk - walk[0]
    return start_at_rest
