"""How far to relax between the conformal and the equiareal sphere.

Paper, Methods, "Stopping criteria for area distortion relaxation of S_Q²". Each criterion
is one number of a map, and the smaller the better. With σ₁ ≥ σ₂ the singular values of the
map of a face, Q = σ₁ / σ₂, and λ its share of the wanted area over its share of the sphere:

- equiareal: mean over the faces of |log λ|, 0 where every face has the wanted share. The
  paper minimises λ itself, whose mean over the faces also falls where faces are too small;
- mips: σ₂/σ₁ + σ₁/σ₂, least for a conformal map, where it is 2;
- q_log_lambda, the paper's isometric error: (1 − θ) Q + θ |log λ|;
- area_mips: (σ₁/σ₂ + σ₂/σ₁) (σ₁σ₂ + 1/(σ₁σ₂))^θ with σ₁σ₂ = 1/λ, as both surfaces have
  unit area; an isometry has 2^(1 + θ).

Ratios of singular values are averaged with the areas of the reference as weights, as the
paper's global Q is; the mean of |log λ| is over the faces, as its global λ is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..charts import Floats, Ints
from ..geometry.distortion import conformal_error
from ..geometry.mesh import face_areas
from ..progress import Progress
from .equiareal import area_error, share_of

CriterionName = Literal["equiareal", "mips", "q_log_lambda", "area_mips"]
TargetName = Literal["reference", "uniform"]

PAPERS_THETA = {"q_log_lambda": 0.5, "area_mips": 1.0}

# The search looks at so many places along the slider, then closer around the best of them,
# and gives the blend to a hundredth.
PLACES = 6
CLOSER_LOOKS = 8
DECIMALS = 2

Relax = Callable[[float, Floats, Progress], Floats]


@dataclass(frozen=True, eq=False)
class Criterion:
    """One number of a map from a mesh to the sphere; the smaller the better.

    Attributes
    ----------
    name : str
        "equiareal", "mips", "q_log_lambda" or "area_mips".
    theta : float or None
        The weight θ; None is the paper's.
    vertices : ndarray, (n, 3)
        The mesh that is mapped (the reference).
    faces : ndarray, (m, 3)
    wanted : ndarray, (m,)
        Shares of the area of an equiareal map.
    """

    name: CriterionName
    theta: float | None
    vertices: Floats
    faces: Ints
    wanted: Floats

    def __call__(self, directions: Floats) -> float:
        """The value for unit vectors (n, 3) without flipped or collapsed faces."""
        if self.name == "equiareal":
            return area_error(directions, self.faces, self.wanted)
        q = conformal_error(self.vertices, directions, self.faces)
        theta = PAPERS_THETA.get(self.name, 0.0) if self.theta is None else self.theta
        if self.name == "q_log_lambda":
            error = area_error(directions, self.faces, self.wanted)
            return (1.0 - theta) * self._weighted(q) + theta * error
        mips = q + 1.0 / q
        if self.name == "mips":
            return self._weighted(mips)
        stretch = self.wanted / share_of(face_areas(directions, self.faces))
        return self._weighted(mips * (stretch + 1.0 / stretch) ** theta)

    def _weighted(self, values: Floats) -> float:
        weights = face_areas(self.vertices, self.faces)
        return float(weights @ values / weights.sum())


def wanted_shares(vertices: Floats, faces: Ints, target: TargetName) -> Floats:
    """Shares (m,) of the area of the sphere: as on the mesh, or the same for all faces."""
    if target == "uniform":
        return np.full(len(faces), 1.0 / len(faces))
    return share_of(face_areas(vertices, faces))


def best_blend(
    criterion: Criterion, conformal: Floats, relax: Relax, largest: float, progress: Progress
) -> tuple[float, Floats]:
    """Search along the slider for the blend that is best by a criterion.

    Parameters
    ----------
    criterion : Criterion
    conformal : ndarray, (n, 3)
        The map at blend 0.
    relax : callable(blend, start, progress)
        Unit vectors (n, 3) at a blend, from a map that is close to it.
    largest : float
        The end of the slider.

    Returns
    -------
    blend : float
        To a hundredth.
    tried : ndarray, (k, 2)
        Blends, in rising order, and their values.
    """
    from scipy.optimize import minimize_scalar

    maps = {0.0: conformal}
    values = {0.0: criterion(conformal)}
    most = PLACES + CLOSER_LOOKS

    def value(place: float) -> float:
        at_end = largest - place < 0.5 * 10.0**-DECIMALS
        blend = largest if at_end else round(float(place), DECIMALS)
        if blend not in maps:
            nearest = min(maps, key=lambda known: abs(known - blend))
            part = progress.part((len(maps) - 1) / most, len(maps) / most)
            maps[blend] = relax(blend, maps[nearest], part)
            values[blend] = criterion(maps[blend])
        return values[blend]

    places = np.linspace(0.0, largest, PLACES)
    best = int(np.argmin([value(place) for place in places]))
    bracket = places[max(best - 1, 0)], places[min(best + 1, PLACES - 1)]
    options = {"xatol": 0.5 * 10.0**-DECIMALS, "maxiter": CLOSER_LOOKS}
    minimize_scalar(value, bounds=bracket, method="bounded", options=options)
    tried = np.array(sorted(values.items()))
    return float(tried[tried[:, 1].argmin(), 0]), tried
