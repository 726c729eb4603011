"""The atlas of one cell: its charts, and the maps that carry anything between them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from .charts import (
    UV,
    Direct,
    Mask,
    Plane,
    Protrusions,
    Reference,
    SealedSurface,
    Sphere,
    Surface,
    Topography,
    Volume,
)
from .errors import AxesError, ChartMissingError
from .geometry.flat import FlatSphere
from .geometry.locate import SphericalLocator, SurfaceLocator
from .maps import Mapped, route
from .parameters import Parameters
from .progress import Progress, silent
from .unwrapping.elements import elements, region_mean
from .unwrapping.outermost import OutermostSurface
from .unwrapping.plane import flat_sphere
from .unwrapping.surface import same_mesh
from .unwrapping.topography import TopographyLocator

if TYPE_CHECKING:
    from .annotations import Annotations

Kind = Literal["scalar", "label"]
COORDINATES = {"surface": 3, "volume": 3, "reference": 3, "sphere": 3, "topography": 3, "uv": 2}
# Charts that are computed when they are asked for, or first read.
REQUESTED = {"direct": 2, "plane": 2}
ON_REQUEST = (*REQUESTED, "protrusions")


@dataclass(frozen=True, eq=False)
class Atlas:
    """Charts of one cell and the maps between any two of them.

    Attributes
    ----------
    surface, sealed, reference, sphere, uv, topography
        The charts; see :mod:`napari_unwrap3d.charts`. Reading one that was not computed
        raises :class:`ChartMissingError`.
    direct, plane, protrusions
        What takes time and is needed for some work only: computed when it is asked for, or
        when it is first read.
    mask : Mask
        The cell on the isotropic working grid.
    parameters : Parameters
    quality : mapping
        How good every chart is, JSON-able.
    provenance : mapping
        Version, input, seeds, timings and automatic repairs, JSON-able.
    on_request : mapping
        Those of direct, plane and protrusions that were computed, by name.
    """

    surface: Surface
    sealed: SealedSurface
    reference: Reference
    sphere: Sphere
    uv: UV
    topography: Topography
    mask: Mask
    parameters: Parameters = field(default_factory=Parameters)
    quality: Mapping[str, Any] = field(default_factory=dict)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    on_request: Mapping[str, Any] = field(default_factory=dict)

    def __getattribute__(self, name: str) -> Any:
        value = object.__getattribute__(self, name)
        if value is None and name in type(self).__dataclass_fields__:
            raise ChartMissingError(
                f"The atlas has no {name} yet.",
                hint=f"Run the pipeline up to the step {name!r}.",
            )
        return value

    def has(self, chart: str) -> bool:
        """Whether a chart was computed."""
        if chart in ON_REQUEST:
            return chart in self.on_request
        return object.__getattribute__(self, chart) is not None

    def replaced(self, **changes: Any) -> Atlas:
        """The same atlas with other charts, parameters, quality or provenance.

        Charts that were not computed stay so, which ``dataclasses.replace`` cannot do.
        Annotations are carried along.
        """
        from .annotations.state import moved

        kept = {name: object.__getattribute__(self, name) for name in self.__dataclass_fields__}
        atlas = Atlas(**{**kept, **changes})
        if self.annotated is not None and atlas.has("surface"):
            atlas.annotations.restore(moved(self.annotated, atlas))
        return atlas

    def completed(self, other: Atlas) -> bool:
        """Take the charts on request from another atlas, if it is the same cell otherwise.

        Returns
        -------
        bool
            False where other charts differ, or where one on request is there already that is
            another one: nothing is taken then.
        """
        if not (_same_charts(self, other) and _extends(self.on_request, other.on_request)):
            return False
        for name in ("on_request", "quality", "provenance", "parameters"):
            object.__setattr__(self, name, getattr(other, name))
        return True

    @property
    def direct(self) -> Direct:
        """The sealed surface on the sphere, one to one."""
        chart: Direct = self._requested("direct")
        return chart

    @property
    def plane(self) -> Plane:
        """The flattened surface; where it cannot be one to one, reading it is an error."""
        chart: Plane = self._requested("plane")
        return chart

    @property
    def protrusions(self) -> Protrusions:
        """Every bleb, lamellipodium and filopodium, with its measures."""
        found: Protrusions = self._requested("protrusions")
        return found

    def _requested(self, name: str) -> Any:
        """A chart that is computed when it is first read; it is kept with its numbers."""
        from .requested import ON_REQUEST

        numbers = self.quality.get(name, {})
        if name not in self.on_request and "reason" not in numbers:
            if not self.has("topography"):
                raise ChartMissingError(
                    f"The atlas has no {name} yet.",
                    hint=f"Run the pipeline up to the step {name!r}.",
                )
            charts = partial(getattr, self)
            chart, numbers = ON_REQUEST[name].function(
                charts, self.voxel_um, self.parameters, silent()
            )
            self.keep(name, chart, numbers)
        if name not in self.on_request:
            raise ChartMissingError(
                f"The {name} was refused: {numbers['reason']}", hint=str(numbers.get("hint", ""))
            )
        return self.on_request[name]

    def keep(self, name: str, chart: Any, numbers: Mapping[str, Any]) -> None:
        """Keep something on request and its numbers, in the place of what there was.

        Parameters
        ----------
        name : str
            "direct", "plane" or "protrusions".
        chart : Direct, Plane or Protrusions, or None
            None where it was refused, and the numbers say why.
        numbers : mapping
            For ``quality``.
        """
        # New mappings: copies of this atlas must not share what is computed later.
        kept = self.on_request if chart is None else {**self.on_request, name: chart}
        object.__setattr__(self, "on_request", kept)
        object.__setattr__(self, "quality", {**self.quality, name: numbers})

    @property
    def voxel_um(self) -> float:
        """Edge of the working voxel in µm."""
        return self.mask.voxel_size[0]

    # Maps of points ----------------------------------------------------------------

    def map(self, points: npt.ArrayLike, source: str, target: str) -> Mapped:
        """Map points from one chart to another.

        Parameters
        ----------
        points : array-like, (n, k)
            surface, reference, volume: (z, y, x) in µm; sphere: (z, y, x) unit vectors; uv,
            direct, plane: (v, u) in pixels; topography: (d µm, v, u).
        source, target : str
            "surface", "reference", "volume", "sphere", "uv", "topography", "direct" or "plane".

        Returns
        -------
        mapped : ndarray, (n, k')
            NaN where a point has no image.
        valid : ndarray, (n,) bool
            Whether a point has an image: inside the mapped shell around the reference, on the
            surface within a voxel, over a pixel whose normal meets the surface.
            From uv, sphere and reference to the surface the image is the outermost crossing;
            from uv to topography it is d = 0. Surface and direct, and surface and plane, are one
            to one, but for where the sealed surface closes or cuts a handle.

        Raises
        ------
        ChartMissingError
            A chart that is needed was not computed, or the name is unknown.
        AxesError
            The points have the wrong number of coordinates.
        """
        current = np.array(points, dtype=np.float64)
        coordinates = COORDINATES | REQUESTED
        for name in (source, target):
            if name not in coordinates:
                raise ChartMissingError(
                    f"There is no chart {name!r}.", hint=f"Charts: {', '.join(coordinates)}."
                )
        if current.ndim != 2 or current.shape[1] != coordinates[source]:
            raise AxesError(
                f"Points of {source} have {coordinates[source]} coordinates.",
                shape=current.shape,
            )
        width = current.shape[1]
        valid = np.asarray(np.isfinite(current).all(axis=1))
        for step in route(self, source, target):
            moved, good = step(current[valid])
            width = moved.shape[1]
            image = np.full((len(current), width), np.nan)
            image[valid] = moved
            kept = valid.copy()
            kept[valid] = good
            current, valid = image, kept
        current[~valid] = np.nan
        return current, valid

    # Locators, built when first needed ---------------------------------------------

    @cached_property
    def _sphere_locator(self) -> SphericalLocator:
        return SphericalLocator(self.sphere.vertices, self.sphere.faces)

    @cached_property
    def _reference_locator(self) -> SurfaceLocator:
        return SurfaceLocator(self.reference.vertices, self.reference.faces)

    @cached_property
    def _surface_locator(self) -> SurfaceLocator:
        return SurfaceLocator(self.surface.vertices, self.surface.faces)

    @cached_property
    def _sealed_locator(self) -> SurfaceLocator:
        if same_mesh(self.sealed, self.surface):
            return self._surface_locator
        return SurfaceLocator(self.sealed.vertices, self.sealed.faces)

    @cached_property
    def _direct_locator(self) -> SphericalLocator:
        return SphericalLocator(self.direct.vertices @ self.direct.rotation.T, self.direct.faces)

    @cached_property
    def _flat_sphere(self) -> FlatSphere:
        return flat_sphere(self.plane, self.sealed.faces)

    @cached_property
    def _topography_locator(self) -> TopographyLocator:
        chart = self.topography
        return TopographyLocator(chart.nodes, chart.d_um, self.voxel_um)

    @cached_property
    def outermost(self) -> OutermostSurface:
        """The outermost crossing of the surface over every (v, u)."""
        return OutermostSurface(self.surface, self.topography)

    # Carrying values ---------------------------------------------------------------

    def carry(
        self,
        values: Volume | npt.ArrayLike,
        source: str,
        target: str,
        kind: Kind = "scalar",
        progress: Progress | None = None,
    ) -> Any:
        """Carry values given on one chart to another.

        Every vertex, pixel or node of the target looks up the value at its image on the
        source: interpolated for scalars, chosen for labels.

        Parameters
        ----------
        values : array-like or Volume
            surface, reference, sphere: one per vertex; uv, direct, plane: (N, 2N); topography:
            (D, N, 2N); volume: a :class:`Volume`.
        source, target : str
            As in :meth:`map`.
        kind : "scalar" or "label"
        progress : Progress, optional

        Returns
        -------
        ndarray or Volume
            As `values`, on the target. Scalars are NaN and labels 0 without an image.
        """
        from .carrying import carry

        return carry(self, values, source, target, kind, progress or silent())

    # Measuring ---------------------------------------------------------------------

    def elements(self, chart: str) -> npt.NDArray[Any]:
        """What every vertex, pixel or node of a chart stands for.

        Parameters
        ----------
        chart : str
            "surface", "sealed" or "reference": area in µm² of every vertex (n,), "uv": of every
            pixel (N, 2N) (the paper's dA), "topography": volume in µm³ of every node (D, N, 2N)
            (the paper's dV). The sphere has the areas of the reference.
        """
        if chart == "topography":
            return self._node_volumes
        if chart not in ("surface", "sealed", "reference", "sphere", "uv"):
            raise ChartMissingError(f"There is no chart {chart!r} with areas or volumes.")
        return elements(getattr(self, "reference" if chart == "sphere" else chart))

    @cached_property
    def _node_volumes(self) -> npt.NDArray[Any]:
        return elements(self.topography)

    def region_mean(
        self, values: npt.ArrayLike, region: npt.ArrayLike | None = None, chart: str = "uv"
    ) -> float:
        """Mean of a field over a region of a chart, corrected for the chart's distortion.

        Parameters
        ----------
        values : array-like
            One per vertex, pixel or node of the chart; NaN does not count.
        region : array-like of bool, optional
            Of the same shape; everything unless given.
        chart : str
            As in :meth:`elements`.

        Returns
        -------
        float
            NaN where the region is empty.
        """
        return region_mean(values, region, self.elements(chart))

    # Annotations -------------------------------------------------------------------

    @cached_property
    def annotations(self) -> Annotations:
        """Labels, shapes and points that a person drew; saved with the atlas."""
        from .annotations import Annotations

        return Annotations(self)

    @property
    def annotated(self) -> Annotations | None:
        """The annotations, if anyone ever asked for them."""
        found: Annotations | None = self.__dict__.get("annotations")
        return found

    # Files -------------------------------------------------------------------------

    def save(self, path: str | Path) -> Path:
        """Write everything into one ``*.unwrap3d`` file."""
        from .files.project import save_project

        return save_project(self, path)


def load(path: str | Path) -> Atlas:
    """Read an atlas from a ``*.unwrap3d`` file."""
    from .files.project import load_project

    return load_project(path)


# By what a chart is told from another: fields may have been added to a copy of it.
PARTS = {
    "surface": "vertices",
    "sealed": "vertices",
    "reference": "vertices",
    "sphere": "vertices",
    "uv": "face",
    "topography": "nodes",
    "mask": "data",
}


def _same_charts(one: Atlas, other: Atlas) -> bool:
    """Whether two atlases share the arrays of every chart that is not on request."""
    if any(one.has(name) != other.has(name) for name in PARTS):
        return False
    return all(
        getattr(getattr(one, name), part) is getattr(getattr(other, name), part)
        for name, part in PARTS.items()
        if one.has(name)
    )


def _extends(some: Mapping[str, Any], more: Mapping[str, Any]) -> bool:
    return all(more.get(name) is chart for name, chart in some.items())
