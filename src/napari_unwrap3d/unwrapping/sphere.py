"""Steps 2 and 3: the reference on the unit sphere, conformal, equiareal, or between."""

from __future__ import annotations

import numpy as np

from ..charts import Floats, Reference, Sphere
from ..geometry.laplacian import Factor, ReusedFactor
from ..geometry.spherical_embedding import EmbeddingWeights, embed_on_sphere
from ..parameters import SphereParameters
from ..progress import Progress
from .advection import advected_sphere
from .conformal import conformal_sphere
from .criteria import Criterion, best_blend, wanted_shares
from .equiareal import area_error, blended_target, equiareal_sphere

# A flow that ends above this mean |log λ| was held up by thin faces; it wrinkles the others.
STALLED = 0.05


def sphere(reference: Reference, parameters: SphereParameters, progress: Progress) -> Sphere:
    """Map the reference one to one onto the unit sphere.

    Areas are relaxed by the Poisson flow, where a criterion other than the areas chooses
    the blend, or by the paper's advection, where it chooses the iteration. Where the flow
    stalls, as on the thin faces of a mesh that was kept, the hierarchical embedding is taken
    if its areas are better.

    Raises
    ------
    FlippedFacesError
        No map without flipped faces was found.
    """
    vertices, faces = reference.vertices, reference.faces
    solver = ReusedFactor()
    conformal = conformal_sphere(vertices, faces, progress.part(0.0, 0.6), solver)
    wanted = wanted_shares(vertices, faces, parameters.target)
    criterion = Criterion(parameters.criterion, parameters.theta, vertices, faces, wanted)
    rest = progress.part(0.6, 1.0)
    if parameters.method == "advection":
        return _advected(conformal, criterion, parameters, rest)
    return _flowed(conformal, criterion, parameters, solver.factor, rest)


def _flowed(
    conformal: Floats,
    criterion: Criterion,
    parameters: SphereParameters,
    factor: Factor | None,
    progress: Progress,
) -> Sphere:
    """By the Poisson flow, at the given blend or at the best one up to there."""

    def relaxed(blend: float, start: Floats, part: Progress) -> tuple[Floats, Floats]:
        return equiareal_sphere(
            criterion.vertices,
            conformal,
            criterion.faces,
            part,
            blend=blend,
            iterations=parameters.iterations,
            tolerance=parameters.tolerance,
            wanted=criterion.wanted,
            start=start,
            factor=factor,
        )

    blend, tried, rest = parameters.blend, np.zeros((0, 2)), progress
    if criterion.name != "equiareal":
        search, rest = progress.part(0.0, 0.8), progress.part(0.8, 1.0)
        blend, tried = best_blend(
            criterion, conformal, lambda *given: relaxed(*given)[0], parameters.blend, search
        )
    # From the conformal map again, so that the blend alone says which map it is.
    directions, history = relaxed(blend, conformal, rest.part(0.0, 0.5))
    if history[-1] > STALLED and blend == 1.0 and parameters.target == "reference":
        embedded = _embedded(conformal, criterion, rest.part(0.5, 1.0))
        error = area_error(embedded, criterion.faces, criterion.wanted)
        if error < history[-1]:
            directions, history = embedded, np.append(history, error)
    return Sphere(
        vertices=directions,
        faces=criterion.faces,
        conformal=conformal,
        blend=blend,
        error_history=history,
        target=parameters.target,
        criterion=criterion.name,
        criterion_value=criterion(directions),
        criterion_history=tried,
    )


def _embedded(conformal: Floats, criterion: Criterion, progress: Progress) -> Floats:
    """The hierarchical embedding with areas before angles, turned as the conformal map is."""
    return embed_on_sphere(
        criterion.vertices,
        criterion.faces,
        progress,
        towards=conformal,
        confidence=np.ones(len(conformal)),
        weights=EmbeddingWeights(tie=0.0),
    )


def _advected(
    conformal: Floats, criterion: Criterion, parameters: SphereParameters, progress: Progress
) -> Sphere:
    """By the paper's advection, at the best iteration."""
    faces = criterion.faces
    found = advected_sphere(
        conformal,
        faces,
        blended_target(criterion.wanted, conformal, faces, parameters.blend),
        criterion,
        progress,
        iterations=parameters.iterations,
        tolerance=parameters.tolerance,
        step=parameters.step,
        delta=parameters.delta,
    )
    return Sphere(
        vertices=found.directions,
        faces=faces,
        conformal=conformal,
        blend=parameters.blend,
        error_history=found.errors,
        method="advection",
        iteration=found.iteration,
        target=parameters.target,
        criterion=criterion.name,
        criterion_value=float(found.values[found.iteration]),
        criterion_history=np.column_stack([np.arange(len(found.values)), found.values]),
        flip_history=found.flips,
    )
