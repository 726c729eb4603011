"""Step 4: the axis around which the sphere is unwrapped."""

from __future__ import annotations

import numpy as np

from ..charts import Floats, Reference, Sphere, Surface
from ..errors import InputError, ParameterError
from ..geometry.laplacian import vertex_mass
from ..geometry.locate import SurfaceLocator, interpolate
from ..geometry.mesh import face_areas
from ..parameters import UVParameters

CURVATURE = "mean_curvature_per_um"
# An axis of the cell that lies closer than about 17° to the poles does not say where u begins.
CLOSEST_SINE = 0.3


def axis_rotation(reference: Reference, sphere: Sphere, parameters: UVParameters) -> Floats:
    """Proper rotation (3, 3) of the sphere that the parameters ask for.

    ``sphere.vertices @ rotation.T`` have the north pole at +z and the middle column of the
    image towards +x, all in (z, y, x).
    """
    if parameters.axis_zyx is None:
        weight = axis_weight(reference, parameters.axis_weight, parameters.axis_field)
        rotation = unwrapping_rotation(sphere.vertices, weight * np.sqrt(vertex_mass_of(sphere)))
    else:
        rotation = rotation_by_hand(reference, sphere, np.array(parameters.axis_zyx))
    if parameters.axis_roll_degrees:
        return rolled(rotation, parameters.axis_roll_degrees)
    return rotation


def vertex_mass_of(sphere: Sphere) -> Floats:
    """Area of the sphere around each vertex, summing to 1."""
    mass = vertex_mass(sphere.vertices, sphere.faces)
    share: Floats = mass / mass.sum()
    return share


def axis_weight(reference: Reference, kind: str, name: str = CURVATURE) -> Floats:
    """Weight (n,) per vertex of the reference; see :class:`UVParameters`.

    Parameters
    ----------
    kind : str
        "mean_curvature", "absolute_curvature", "positive_curvature" (1 in the highest of three
        classes by Otsu's thresholds, 0 elsewhere), "field" or "none".
    name : str
        The field of the reference for "field".

    Raises
    ------
    ParameterError
        There is no such field, or it is not one finite number per vertex.
    """
    if kind == "field":
        return _field(reference, name)
    curvature = np.asarray(reference.fields[CURVATURE], dtype=np.float64)
    if kind == "none":
        return np.ones(len(curvature))
    if kind == "absolute_curvature":
        return np.abs(curvature)
    if kind == "positive_curvature":
        from skimage.filters import threshold_multiotsu

        positive = curvature > threshold_multiotsu(curvature, classes=3)[-1]
        return np.asarray(positive, dtype=np.float64)
    return curvature


def _field(reference: Reference, name: str) -> Floats:
    if name not in reference.fields:
        raise ParameterError(
            f"There is no field {name!r} to weigh the axis by.",
            hint=f"Fields of the reference: {', '.join(reference.fields) or 'none'}; a field of "
            "the surface is taken as well.",
        )
    values = np.asarray(reference.fields[name], dtype=np.float64)
    if values.ndim != 1 or not np.isfinite(values).all():
        raise ParameterError(
            f"The field {name!r} cannot weigh the axis.",
            shape=values.shape,
            not_finite=int((~np.isfinite(values)).sum()),
            hint="Choose a field with one finite number per vertex.",
        )
    return values


def with_field_of(reference: Reference, surface: Surface, name: str) -> Reference:
    """The reference with a field of the surface, from the point of it that is nearest.

    A field that the reference has already, or that the surface does not have, changes nothing.
    """
    if name in reference.fields or name not in surface.fields:
        return reference
    locator = SurfaceLocator(surface.vertices, surface.faces)
    face, weights, _ = locator.closest(reference.vertices)
    values = interpolate(surface.fields[name], surface.faces, face, weights)
    carried: Reference = reference.with_fields(**{name: values})
    return carried


def unwrapping_rotation(directions: Floats, weights: Floats) -> Floats:
    """Proper rotation (3, 3) that turns the unwrapping axis to +z (paper, Step 4).

    The axis is the eigenvector of the smallest eigenvalue of ``Σ (w v)(w v)ᵀ``, so that what
    weighs most lies near the equator; it turns with the sphere. Which of its ends is north,
    and where u begins, follows the paper: the first eigenvector has a positive x and the
    second a positive y component, the third is their cross product.

    Parameters
    ----------
    directions : ndarray, (n, 3)
        Unit vectors (z, y, x).
    weights : ndarray, (n,)

    Returns
    -------
    ndarray, (3, 3)
        ``directions @ rotation.T`` are the turned unit vectors, still (z, y, x).
    """
    if not np.isfinite(weights).all() or not np.any(weights):
        raise InputError(
            "The weights of the unwrapping axis are all zero or not finite.",
            hint="Choose another axis weight, or none.",
        )
    weighted = weights[:, None] * directions[:, ::-1]
    _, vectors = np.linalg.eigh(weighted.T @ weighted)
    e1, e2 = vectors[:, 2], vectors[:, 1]
    e1 = e1 if e1[0] >= 0 else -e1
    e2 = e2 if e2[1] >= 0 else -e2
    e3 = np.cross(e1, e2)
    rotation_xyz = np.stack([e1, e2, e3])
    rotation: Floats = rotation_xyz[::-1, ::-1].copy()
    return rotation


def rotation_by_hand(reference: Reference, sphere: Sphere, axis: Floats) -> Floats:
    """Proper rotation (3, 3) that puts the north pole where a direction leaves the reference.

    Parameters
    ----------
    axis : ndarray, (3,)
        (z, y, x) of any length, from the reference's centroid; the outermost crossing counts.

    Returns
    -------
    ndarray, (3, 3)
        The middle column of the image goes through the point of the reference in +x from its
        centroid; where that lies too close to a pole, in +y, and else in +z.

    Raises
    ------
    InputError
        The direction has no length, or no line along it through the centroid meets the
        reference.
    """
    length = float(np.linalg.norm(axis))
    if not 0.0 < length < np.inf:
        raise InputError(
            "The unwrapping axis has no direction.",
            length=length,
            hint="Give three finite numbers (z, y, x) that are not all 0.",
        )
    towards = np.concatenate([axis[None] / length, np.eye(3)[::-1]])
    north, *sides = _where_left(reference, sphere, towards)
    if not np.isfinite(north).all():
        raise InputError(
            "The line along the axis through the centroid does not meet the reference.",
            axis_zyx=tuple(float(a) for a in axis),
            hint="Choose another direction.",
        )
    sine = [np.nan_to_num(np.linalg.norm(np.cross(north, side))) for side in sides]
    clear = [index for index, size in enumerate(sine) if size > CLOSEST_SINE]
    return frame(north, sides[clear[0] if clear else int(np.argmax(sine))])


def frame(north: Floats, towards: Floats) -> Floats:
    """Proper rotation (3, 3) whose rows are z = north, y, and x as close to `towards` as can be.

    All are vectors (z, y, x) of any length.
    """
    z = north / np.linalg.norm(north)
    across = towards - (towards @ z) * z
    x = across / np.linalg.norm(across)
    # In (z, y, x) the cross product changes its sign: y = z × x.
    return np.stack([z, -np.cross(z, x), x])


def _where_left(reference: Reference, sphere: Sphere, towards: Floats) -> Floats:
    """Unit vectors (n, 3) on the sphere of the reference's outermost points in directions (n, 3).

    NaN where a line through the centroid misses the reference.
    """
    vertices, faces = reference.vertices, reference.faces
    area = face_areas(vertices, faces)
    centre = area @ vertices[faces].mean(axis=1) / area.sum()
    far = 2.0 * np.linalg.norm(vertices - centre, axis=1).max() * towards
    face, weights = SurfaceLocator(vertices, faces).first_hit(centre + far, centre - far)
    images = interpolate(sphere.vertices, sphere.faces, face, weights)
    images /= np.linalg.norm(images, axis=1, keepdims=True)
    images[face < 0] = np.nan
    return images


def rolled(rotation: Floats, degrees: float) -> Floats:
    """The rotation turned around the axis: what lay at this azimuth comes to azimuth 0."""
    angle = np.deg2rad(degrees)
    cosine, sine = np.cos(angle), np.sin(angle)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])
    result: Floats = turn @ rotation
    return result
