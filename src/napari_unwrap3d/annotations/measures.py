"""What the labels of an annotation measure on the surface."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..charts import Floats
from ..errors import InputError
from ..unwrapping.elements import region_means
from .annotations import Annotations

if TYPE_CHECKING:
    from ..atlas import Atlas

FEWEST_VERTICES = 3


def label_rows(
    annotations: Annotations, fields: Mapping[str, npt.NDArray[Any]] | None = None
) -> list[dict[str, Any]]:
    """A row per annotation and label: how large it is, and the means of fields over it.

    Everything is measured on the surface, so that no chart's distortion is in it.

    Parameters
    ----------
    annotations : Annotations
    fields : mapping of str to ndarray, (n,), optional
        One value per vertex of the surface; NaN does not count. The surface's own fields
        and the height over the reference unless given.

    Returns
    -------
    list of dict
        ``annotation``, ``label``, ``vertices``, ``area_um2``, ``fraction`` (of the surface)
        and ``mean_`` with the name of every field. Ready for ``files.tables.write_table``.
    """
    areas = annotations.atlas.elements("surface")
    chosen = surface_fields(annotations.atlas) if fields is None else dict(fields)
    rows = []
    for name in annotations.names:
        labels = annotations.labels(name)
        count = np.bincount(labels)
        area = np.bincount(labels, areas)
        means = {key: region_means(values, labels, areas) for key, values in chosen.items()}
        rows += [
            {
                "annotation": name,
                "label": int(label),
                "vertices": int(count[label]),
                "area_um2": float(area[label]),
                "fraction": float(area[label] / areas.sum()),
                **{f"mean_{key}": float(values[label]) for key, values in means.items()},
            }
            for label in np.flatnonzero(count)
            if label > 0
        ]
    return rows


def surface_fields(atlas: Atlas) -> dict[str, Floats]:
    """The fields of the surface as one value per vertex each, and its height."""
    fields: dict[str, Floats] = {}
    for name, values in atlas.surface.fields.items():
        columns = np.asarray(values, dtype=np.float64).reshape(len(values), -1)
        for index, column in enumerate(columns.T):
            fields[name if columns.shape[1] == 1 else f"{name}_{index}"] = column
    if atlas.has("topography"):
        fields.setdefault("height_um", atlas.topography.surface[:, 0])
    return fields


@dataclass(frozen=True)
class PlaneFit:
    """The plane that fits a patch of the surface best.

    Attributes
    ----------
    centroid_um : tuple
        (z, y, x), the patch's centre of area; the plane goes through it.
    normal : tuple
        Unit vector (z, y, x), away from the cell's centre.
    rms_um : float
        Root mean square distance of the patch from the plane.
    area_um2 : float
        Of the patch.
    """

    centroid_um: tuple[float, float, float]
    normal: tuple[float, float, float]
    rms_um: float
    area_um2: float


def fit_plane(annotations: Annotations, name: str, label: int = 1) -> PlaneFit:
    """Fit a plane to a label by principal components, every vertex weighed by its area.

    For a label drawn where the cell lies on the glass, the normal is the direction down,
    across which lateral speeds are measured.

    Raises
    ------
    InputError
        The label has too few vertices, or they lie on a line.
    """
    surface, areas = annotations.atlas.surface, annotations.atlas.elements("surface")
    chosen = annotations.labels(name) == label
    if np.count_nonzero(chosen) < FEWEST_VERTICES or areas[chosen].sum() <= 0:
        raise InputError(
            f"A plane needs three vertices or more of label {label} in {name!r}.",
            vertices=int(np.count_nonzero(chosen)),
            hint="Draw a larger region.",
        )
    points, weights = surface.vertices[chosen], areas[chosen]
    centroid = weights @ points / weights.sum()
    away = points - centroid
    variance, axes = np.linalg.eigh((away * weights[:, None]).T @ away / weights.sum())
    if variance[1] <= 1e-12 * variance[2]:
        raise InputError(
            f"The vertices of label {label} in {name!r} lie on a line.", hint="Draw a wider region."
        )
    normal = axes[:, 0]
    centre = areas @ surface.vertices / areas.sum()
    if normal @ (centroid - centre) < 0:
        normal = -normal
    return PlaneFit(
        _three(centroid),
        _three(normal),
        float(np.sqrt(max(variance[0], 0.0))),
        float(weights.sum()),
    )


def _three(vector: Floats) -> tuple[float, float, float]:
    z, y, x = vector.tolist()
    return z, y, x
