"""Steps 2 and 3: the reference on the unit sphere, conformal, equiareal, or between."""

from __future__ import annotations

from ..charts import Reference, Sphere
from ..parameters import SphereParameters
from ..progress import Progress
from .conformal import conformal_sphere
from .equiareal import equiareal_sphere


def sphere(reference: Reference, parameters: SphereParameters, progress: Progress) -> Sphere:
    """Map the reference one to one onto the unit sphere.

    Raises
    ------
    FlippedFacesError
        No map without flipped faces was found.
    """
    vertices, faces = reference.vertices, reference.faces
    conformal = conformal_sphere(vertices, faces, progress.part(0.0, 0.6))
    directions, history = equiareal_sphere(
        vertices,
        conformal,
        faces,
        progress.part(0.6, 1.0),
        blend=parameters.blend,
        iterations=parameters.iterations,
        tolerance=parameters.tolerance,
    )
    return Sphere(
        vertices=directions,
        faces=faces,
        conformal=conformal,
        blend=parameters.blend,
        error_history=history,
    )
