"""What the charts can be coloured by: fields of a cell, and their values on every chart.

A field is given on one chart, its home, and carried to the others by the atlas. Charts
hang together as a tree, so that every value takes one known way; what was computed once
is kept for as long as the atlas lives.
"""

from __future__ import annotations

import weakref
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from .atlas import Atlas
from .carrying import sample_volume
from .charts import Floats, Protrusions, Stack, Volume
from .errors import ChartMissingError, ParameterError
from .geometry.locate import interpolate
from .imaging.roi import chosen_volume
from .places import Place
from .progress import Progress, silent
from .protrusions.columns import COLUMNS
from .sampling import sample_signal
from .shell import Shell, ShellVolume
from .unwrapping.surface import same_mesh

Values = npt.NDArray[np.float32]

CURVATURE = "mean_curvature_per_um"
GAUSSIAN = "gaussian_curvature_per_um2"
HEIGHT = "height_um"
REFERENCE_CURVATURE = "reference_curvature_per_um"
AREA_DISTORTION = "area_distortion"
CONFORMAL_ERROR = "conformal_error"
SIGNAL = "signal_"
PROTRUSION = "protrusion_"
# Columns of the table of protrusions that say which they are and where, not what they are like.
WHICH = ("label", "motif", "z_um", "y_um", "x_um", "v_px", "u_px", "axis_z", "axis_y", "axis_x")

# The chart from which each chart's values come: every field is carried along this tree.
CARRIED_FROM = {
    "sealed": "surface",
    "uv": "surface",
    "direct": "surface",
    "plane": "surface",
    "reference": "uv",
    "sphere": "reference",
}
CHARTS = ("surface", *CARRIED_FROM)

SIGNED = (CURVATURE, GAUSSIAN, REFERENCE_CURVATURE, "surface_mean_curvature_per_um")
DIVERGING = "coolwarm"
ROBUST_PERCENT = (1.0, 99.0)
LARGEST_SAMPLE = 200_000


@dataclass(frozen=True)
class Field:
    """One thing that a cell can be coloured by.

    Attributes
    ----------
    name : str
        Unique within an atlas.
    title : str
        What a person reads, without the unit.
    unit : str
        Empty for a ratio, or for intensities.
    home : str
        The chart on which it is given.
    channel : int or None
        The channel of the stack that has to be sampled for it, which takes seconds.
    """

    name: str
    title: str
    unit: str
    home: str
    channel: int | None = None

    @property
    def label(self) -> str:
        """Title and unit."""
        return f"{self.title} ({self.unit})" if self.unit else self.title


KNOWN = {
    CURVATURE: ("Mean curvature", "1/µm"),
    HEIGHT: ("Height d", "µm"),
    GAUSSIAN: ("Gaussian curvature", "1/µm²"),
    AREA_DISTORTION: ("Area distortion λ", ""),
    CONFORMAL_ERROR: ("Conformal error Q", ""),
    REFERENCE_CURVATURE: ("Reference curvature", "1/µm"),
}


@dataclass(frozen=True)
class Colours:
    """How a field is drawn: a colormap by its name, and the values at its two ends."""

    colormap: str
    limits: tuple[float, float]


def colours_of(name: str, values: npt.ArrayLike) -> Colours:
    """Colormap and limits of a field, from the 1st and the 99th percentile of its values.

    Curvatures have both signs and are drawn symmetrically about zero.

    Parameters
    ----------
    name : str
    values : array-like
        NaN and infinite ones do not count.
    """
    given = np.asarray(values).ravel()
    # Percentiles of a part are near enough, and fifty times faster on a large image.
    given = given[:: max(len(given) // LARGEST_SAMPLE, 1)]
    finite = given[np.isfinite(given)].astype(float)
    low, high = np.percentile(finite, ROBUST_PERCENT) if finite.size else (0.0, 1.0)
    if name in SIGNED:
        limit = float(max(abs(low), abs(high))) or 1.0
        return Colours(DIVERGING, (-limit, limit))
    if name == CONFORMAL_ERROR:
        return Colours("magma", (1.0, float(max(high, 1.05))))
    colormap = "viridis" if name.endswith(HEIGHT) or name.startswith(PROTRUSION) else "magma"
    if not high > low:
        high = low + 1.0
    return Colours(colormap, (float(low), float(high)))


class Fields:
    """The fields of one atlas. Get it with :func:`fields_of`.

    Parameters
    ----------
    atlas : Atlas
        With its surface; other charts may be missing.
    stack : Stack, optional
        What the atlas was made from; its channels are fields too.
    """

    def __init__(self, atlas: Atlas, stack: Stack | None = None) -> None:
        # Kept alongside the atlas, so it must not keep the atlas alive.
        self._atlas = weakref.ref(atlas)
        self.stack = stack
        self._values: dict[tuple[str, str], Values] = {}
        self._shell: Shell | None = None
        self._found: Protrusions | None = None
        self._fields = {field.name: field for field in _catalogue(atlas, stack)}
        self.renew()

    def renew(self) -> bool:
        """Look at the atlas' protrusions, found or edited since; True where they are others."""
        found = self.atlas.on_request.get("protrusions")
        if found is self._found:
            return False
        self._found = found
        self._fields = {n: f for n, f in self._fields.items() if not n.startswith(PROTRUSION)}
        self._fields |= {field.name: field for field in _of_protrusions(found)}
        for key in [key for key in self._values if key[0].startswith(PROTRUSION)]:
            del self._values[key]
        return True

    @property
    def names(self) -> tuple[str, ...]:
        """What there is, the most useful first."""
        return tuple(self._fields)

    @property
    def atlas(self) -> Atlas:
        atlas = self._atlas()
        if atlas is None:
            raise ChartMissingError("The atlas of these fields is gone.")
        return atlas

    def field(self, name: str) -> Field:
        """A field by its name; :class:`ParameterError` where there is none."""
        if name not in self._fields:
            raise ParameterError(
                f"There is no field {name!r}.", hint=f"Fields: {', '.join(self._fields)}."
            )
        return self._fields[name]

    def known(self, name: str, chart: str) -> bool:
        """Whether the values are there already, so that reading them takes no time."""
        return (name, chart) in self._values

    def values(self, name: str, chart: str, progress: Progress | None = None) -> Values:
        """Values of a field on a chart, computed when they are first asked for.

        Parameters
        ----------
        name : str
            One of :attr:`names`.
        chart : str
            One of :data:`CHARTS`. "direct" and "plane" are not computed for this.
        progress : Progress, optional
            Sampling a channel takes seconds.

        Returns
        -------
        ndarray, float32
            One per vertex, or (N, 2N) for uv, direct and plane; NaN where there is none.

        Raises
        ------
        ParameterError
            There is no such field.
        ChartMissingError
            The atlas does not have the chart, or it has no fields.
        """
        key = (name, chart)
        if key not in self._values:
            field = self.field(name)
            report = progress or silent()
            found = (
                self._at_home(field, report)
                if chart == field.home
                else self._carried(name, _nearer(chart, field.home), chart, report)
            )
            self._values[key] = np.ascontiguousarray(found, dtype=np.float32)
        return self._values[key]

    def in_topography(
        self, name: str, progress: Progress | None = None
    ) -> ShellVolume | npt.NDArray[Any]:
        """A field in the topography's (d, v, u), the same values as everywhere.

        A field of the surface is given at the nodes next to it, height as the d of each node
        of the cell there. A signal is sampled everywhere, see :func:`topography_signal`.

        Parameters
        ----------
        name : str
        progress : Progress, optional
            It takes a second and more when the first field is asked for, and for signals.

        Returns
        -------
        ShellVolume or ndarray, (D, N, 2N)
            Not kept here: a signal takes hundreds of megabytes.

        Raises
        ------
        ParameterError
            There is no such field.
        ChartMissingError
            The atlas has no topography.
        """
        field, report = self.field(name), progress or silent()
        chart = self.atlas.topography
        if field.channel is not None:
            assert self.stack is not None
            return topography_signal(self.atlas, self.stack, field.channel, report)
        if self._shell is None:
            report(0.0, "the surface in the topography")
            self._shell = Shell.of(self.atlas)
        if name == HEIGHT:
            inside = self._shell.within(chart.mask)
            return ShellVolume(inside, chart.d_um[inside.layer])
        return ShellVolume(self._shell, self.values(name, "surface", report)[self._shell.vertex])

    def reachable(self, name: str, chart: str) -> bool:
        """Whether the atlas has what is needed to carry a field to a chart."""
        atlas, home = self.atlas, self.field(name).home
        while chart != home:
            nearer = _nearer(chart, home)
            over = {chart, nearer} == {"surface", "uv"}
            if not atlas.has(chart) or (over and not atlas.has("topography")):
                return False
            chart = nearer
        return atlas.has(home)

    def colours(self, name: str) -> Colours:
        """Colormap and limits, the same on every chart: those of the surface's values."""
        chart = "surface" if self.reachable(name, "surface") else self.field(name).home
        return colours_of(name, self.values(name, chart))

    def adopt(self, other: Fields) -> None:
        """Take over what is known of another atlas of the same charts, so that none is lost.

        A run that adds the direct chart or the plane makes a new atlas of the same others.
        """
        mine, theirs = self.atlas, other._atlas()
        if theirs is None or other.stack is not self.stack:
            return
        for chart in ("surface", "sealed", "reference", "uv", "topography"):
            if mine.has(chart) != theirs.has(chart) or (
                mine.has(chart) and _core(mine, chart) is not _core(theirs, chart)
            ):
                return
        self._shell = self._shell or other._shell
        for (name, chart), values in other._values.items():
            same = not name.startswith(PROTRUSION) or self._found is other._found
            if name in self._fields and chart not in ("direct", "plane") and same:
                self._values.setdefault((name, chart), values)

    def at(self, name: str, corners: npt.NDArray[np.integer], weights: Floats) -> float | None:
        """The value at a place on the surface; None before the field's values are known.

        Parameters
        ----------
        name : str
        corners : ndarray, (3,)
            Vertices of the surface.
        weights : ndarray, (3,)
            Barycentric weights.
        """
        values = self._values.get((name, "surface"))
        return None if values is None else float(values[corners] @ weights)

    def at_place(self, name: str, place: Place) -> float | None:
        """The value at a place; None where it is not on the surface, see :meth:`at`."""
        if place.corners is None or place.weights is None:
            return None
        return self.at(name, place.corners, place.weights)

    def _at_home(self, field: Field, progress: Progress) -> npt.NDArray[Any]:
        atlas = self.atlas
        if field.channel is not None:
            assert self.stack is not None
            signal: npt.NDArray[Any] = sample_signal(
                self.stack, atlas, field.channel, progress=progress
            )
            return signal
        if field.name.startswith(PROTRUSION):
            return atlas.protrusions.per_vertex(field.name.removeprefix(PROTRUSION))
        if field.name == GAUSSIAN:
            area = atlas.elements("surface")
            deficit = np.asarray(atlas.surface.fields["gaussian_curvature"])
            return np.asarray(deficit / np.maximum(area, 1e-12))
        if field.name == REFERENCE_CURVATURE:
            return np.asarray(atlas.reference.fields[CURVATURE])
        return np.asarray(getattr(atlas, field.home).fields[field.name])

    def _carried(self, name: str, source: str, chart: str, progress: Progress) -> npt.NDArray[Any]:
        atlas = self.atlas
        if not atlas.has(chart):
            raise ChartMissingError(f"The atlas has no {chart} yet.", hint="Compute it first.")
        values = self.values(name, source, progress)
        if "sealed" in (source, chart):
            return _on_sealed(atlas, values)
        return np.asarray(atlas.carry(values, source, chart, progress=progress))


def _core(atlas: Atlas, chart: str) -> Any:
    """What stays the same object when a chart is given more fields."""
    own = getattr(atlas, chart)
    return own.face if chart == "uv" else own if chart == "topography" else own.vertices


def _catalogue(atlas: Atlas, stack: Stack | None) -> list[Field]:
    """What an atlas with these charts, and a stack, can be coloured by."""
    homes = {}
    if atlas.has("surface"):
        names = [n for n, v in atlas.surface.fields.items() if _is_scalar(v)]
        homes = {GAUSSIAN if n == "gaussian_curvature" else n: "surface" for n in names}
    if atlas.has("uv"):
        homes |= {n: "uv" for n in (AREA_DISTORTION, CONFORMAL_ERROR) if n in atlas.uv.fields}
    if atlas.has("reference") and CURVATURE in atlas.reference.fields:
        homes[REFERENCE_CURVATURE] = "reference"
    order = [*(n for n in KNOWN if n in homes), *(n for n in homes if n not in KNOWN)]
    fields = [Field(n, *KNOWN.get(n, (n.replace("_", " "), "")), homes[n]) for n in order]
    return fields[:2] + _signals(atlas, stack) + fields[2:]


def _of_protrusions(found: Protrusions | None) -> list[Field]:
    """A field per measure of the protrusions."""
    if found is None:
        return []
    return [
        Field(f"{PROTRUSION}{name}", f"Protrusions: {column.title}", column.unit, "surface")
        for name, column in COLUMNS.items()
        if name in found.columns and name not in WHICH
    ]


def _is_scalar(values: npt.ArrayLike) -> bool:
    array = np.asarray(values)
    return array.ndim == 1 and array.dtype.kind in "biuf"


def _signals(atlas: Atlas, stack: Stack | None) -> list[Field]:
    """A field per channel; the numbers of a label image are no signal."""
    if stack is None or atlas.parameters.stack.label is not None:
        return []
    return [
        Field(f"{SIGNAL}{channel}", title, "", "surface", channel)
        for channel, title in enumerate(channel_titles(stack))
    ]


def channel_titles(stack: Stack) -> list[str]:
    """What a person reads for each channel of a stack."""
    if len(stack.channels) > 1:
        return [f"Signal: {name}" for name in stack.channels]
    return ["Signal"]


def _nearer(chart: str, home: str) -> str:
    """The neighbour of a chart in the tree that lies towards a field's home."""
    if chart not in CHARTS:
        raise ChartMissingError(
            f"There are no fields on {chart!r}.", hint=f"Charts: {', '.join(CHARTS)}."
        )
    way = [home]
    while way[-1] in CARRIED_FROM:
        way.append(CARRIED_FROM[way[-1]])
    return way[way.index(chart) - 1] if chart in way else CARRIED_FROM[chart]


def _on_sealed(atlas: Atlas, values: Values) -> npt.NDArray[Any]:
    """Values of the surface at the vertices of the sealed surface."""
    if same_mesh(atlas.sealed, atlas.surface):
        return values
    face, weights, _ = atlas._surface_locator.closest(atlas.sealed.vertices)
    return interpolate(values, atlas.surface.faces, face, weights)


def topography_signal(
    atlas: Atlas, stack: Stack, channel: int | str = 0, progress: Progress | None = None
) -> npt.NDArray[Any]:
    """A channel of the stack in the topography's (d, v, u).

    Parameters
    ----------
    atlas : Atlas
        With its topography.
    stack : Stack
        What the atlas was made from.
    channel : int or str
    progress : Progress, optional

    Returns
    -------
    ndarray, (D, N, 2N)
        In the stack's own integers, 0 outside of it, or as float32 with NaN there.
    """
    report = progress or silent()
    timepoint = atlas.parameters.stack.timepoint if "t" in stack.axes else 0
    volume = Volume(np.asarray(chosen_volume(stack, timepoint, channel)), stack.voxel_size)
    positions = atlas.topography.positions
    whole = volume.data.dtype.kind in "iub"
    found = np.empty(positions.shape[:3], volume.data.dtype if whole else np.float32)
    # Layer by layer: a large topography has a hundred million nodes.
    for layer, points in enumerate(positions):
        report(layer / len(positions), "signal in the topography")
        values = sample_volume(volume, points, label=False)
        found[layer] = np.rint(np.nan_to_num(values)) if whole else values
    return found


_KEPT: weakref.WeakKeyDictionary[Atlas, Fields] = weakref.WeakKeyDictionary()


def fields_of(atlas: Atlas, stack: Stack | None = None) -> Fields:
    """The fields of an atlas; what was computed before is there again.

    Parameters
    ----------
    atlas : Atlas
    stack : Stack, optional
        What the atlas was made from, for its channels.
    """
    kept = _KEPT.get(atlas)
    if kept is None or (stack is not None and kept.stack is not stack):
        kept = _KEPT[atlas] = Fields(atlas, stack)
    kept.renew()
    return kept


def field_titles(atlas: Atlas, stack: Stack | None = None) -> dict[str, str]:
    """Name → title with its unit, of every field of an atlas."""
    fields = fields_of(atlas, stack)
    return {name: fields.field(name).label for name in fields.names}


def field_on(atlas: Atlas, field: str, chart: str, stack: Stack | None = None) -> Values:
    """Values of a field on a chart; see :meth:`Fields.values`."""
    return fields_of(atlas, stack).values(field, chart)
