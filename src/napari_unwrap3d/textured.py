"""Meshes that show an image of theirs as a texture, with annotations over a field.

A texture holds the pixels of an N × 2N chart, then the first of its columns once more for
faces that go on across the seam, and in its last column the colour of what has no image.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from .charts import Floats, Ints
from .errors import ChartMissingError
from .files.texture import texture_corners
from .geometry.locate import interpolate
from .geometry.padding import sample_uv_nearest
from .unwrapping.surface import same_mesh
from .unwrapping.uv import direction_to_uv

if TYPE_CHECKING:
    from .atlas import Atlas

Bools = npt.NDArray[np.bool_]
Colours = npt.NDArray[np.uint8]

WITHOUT_IMAGE = (178, 178, 178)
# How strongly an annotation covers the field below it.
COVER = 0.65
# A face whose image shows a place farther away than this many of its own edges is smeared.
SMEARED_EDGES = 3.0


class Box(NamedTuple):
    """Rows first_row … last_row − 1 and columns first_column … last_column − 1."""

    first_row: int
    last_row: int
    first_column: int
    last_column: int


@dataclass(frozen=True, eq=False)
class Sheet:
    """The pixels of a texture.

    Attributes
    ----------
    rows : int
        N.
    repeated : int
        How many columns are in the texture once more.
    """

    rows: int
    repeated: int

    @classmethod
    def whole(cls, rows: int) -> Sheet:
        """One that is enough for every mesh that was cut at the seam."""
        return cls(rows, rows + 2)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the texture."""
        return self.rows, 2 * self.rows + self.repeated + 1


@dataclass(frozen=True, eq=False)
class Laid(Sheet):
    """How a texture lies on a mesh.

    Attributes
    ----------
    origin : ndarray, (p,) int64
        The vertex of the mesh that each vertex of the textured mesh is a copy of.
    faces : ndarray, (m, 3) int64
        Of the textured mesh, in the order of the mesh's own.
    coordinates : ndarray, (p, 2) float32
        Of its vertices in the texture, from the lower left corner, 0…1.
    """

    origin: Ints
    faces: Ints
    coordinates: npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Skin(Laid):
    """How a chart's image lies on a mesh.

    Attributes
    ----------
    chart : str
        "uv" or "direct".
    pixel_face : ndarray, (N, 2N) int64, pixel_weights : ndarray, (N, 2N, 3)
        The place of the mesh that each pixel shows.
    covered : ndarray, (N, 2N) bool
        Whether a pixel shows a place of the mesh.
    """

    chart: str
    pixel_face: Ints
    pixel_weights: Floats
    covered: Bools

    def image(self, values: npt.ArrayLike, faces: Ints) -> Floats:
        """Values (n,) at the mesh's vertices as an image (N, 2N); NaN where it shows nothing.

        Parameters
        ----------
        values : array-like, (n,)
        faces : ndarray, (m, 3)
            The mesh's own faces, not the textured mesh's.
        """
        flat = interpolate(
            np.asarray(values), faces, self.pixel_face.ravel(), self.pixel_weights.reshape(-1, 3)
        )
        image: Floats = np.where(self.covered, flat.reshape(self.covered.shape), np.nan)
        return image


def skin_chart(atlas: Atlas, mesh: str) -> str:
    """The chart that a mesh shows: every sheet in its own place where the atlas has that."""
    return "direct" if mesh in ("surface", "sealed") and atlas.has("direct") else "uv"


def make_skin(atlas: Atlas, mesh: str) -> Skin:
    """Lay a chart's image on a mesh.

    The surface and the sealed surface show the direct chart. Until the atlas has it, the
    surface shows what lies outermost over each pixel of uv. Takes seconds for a large mesh.

    Parameters
    ----------
    atlas : Atlas
    mesh : str
        "surface", "sealed", "reference" or "sphere".

    Raises
    ------
    ChartMissingError
        The chart is missing, or the mesh has no image.
    """
    if mesh in ("reference", "sphere"):
        return _skin_of_reference(atlas)
    if mesh not in ("surface", "sealed") or (mesh == "sealed" and not atlas.has("direct")):
        raise ChartMissingError(f"The mesh {mesh!r} has no image.")
    return _skin_by_direct(atlas, mesh) if atlas.has("direct") else _skin_by_uv(atlas)


def _skin_of_reference(atlas: Atlas) -> Skin:
    rows = atlas.uv.shape[0]
    vu = direction_to_uv(atlas.sphere.vertices @ atlas.uv.rotation.T, rows)
    covered = np.ones(atlas.uv.shape, bool)
    corners = texture_corners(vu, atlas.sphere.faces, rows)
    return _skin("uv", corners, atlas.sphere.faces, atlas.uv.face, atlas.uv.weights, covered)


def _skin_by_direct(atlas: Atlas, mesh: str) -> Skin:
    chart, surface = atlas.direct, getattr(atlas, mesh)
    rows = chart.shape[0]
    if mesh == "sealed" or same_mesh(atlas.sealed, atlas.surface):
        vu = direction_to_uv(chart.vertices @ chart.rotation.T, rows)
        corners = texture_corners(vu, surface.faces, rows)
        covered = np.ones(chart.shape, bool)
        return _skin("direct", corners, surface.faces, chart.face, chart.weights, covered)
    vu, _ = atlas.map(surface.vertices, "surface", "direct")
    corners = texture_corners(vu, surface.faces, rows)
    points = interpolate(
        atlas.sealed.vertices, atlas.sealed.faces, chart.face.ravel(), chart.weights.reshape(-1, 3)
    )
    face, weights, distance = atlas._surface_locator.closest(points)
    covered = (distance <= atlas.voxel_um).reshape(chart.shape)
    corners[_smeared(surface.vertices, surface.faces, corners, points, covered)] = np.nan
    place = face.reshape(chart.shape), weights.reshape(*chart.shape, 3)
    return _skin("direct", corners, surface.faces, *place, covered)


def _skin_by_uv(atlas: Atlas) -> Skin:
    surface, over = atlas.surface, atlas.outermost
    corners = texture_corners(atlas.topography.surface[:, 1:], surface.faces, len(over.face))
    covered = np.asarray(over.face >= 0)
    return _skin("uv", corners, surface.faces, over.face, over.weights, covered)


def _smeared(
    vertices: Floats, faces: Ints, corners: Floats, points: Floats, covered: Bools
) -> Bools:
    """Faces (m,) whose image shows another place: their corners are torn apart in the chart.

    Where the surface has a handle and the sealed surface a membrane, neighbours on the
    surface may lie on both sides of it.
    """
    rows = len(covered)
    spread = vertices[faces]
    size = np.linalg.norm(spread - np.roll(spread, 1, axis=1), axis=2).max(axis=1)
    middle = corners.mean(axis=1)
    known = np.isfinite(middle).all(axis=1)
    pixel = sample_uv_nearest(np.arange(covered.size).reshape(covered.shape), middle[known])
    smeared = np.zeros(len(faces), bool)
    away = np.linalg.norm(points[pixel] - spread[known].mean(axis=1), axis=1)
    # A face smaller than a pixel shows the pixel's centre, some way off.
    pixel_um = np.sqrt(_area(vertices, faces) / (2 * rows**2))
    smeared[known] = away > SMEARED_EDGES * np.maximum(size[known], pixel_um)
    return smeared


def _area(vertices: Floats, faces: Ints) -> float:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def _skin(
    chart: str, corners: Floats, faces: Ints, face: Ints, weights: Floats, covered: Bools
) -> Skin:
    """Cut a mesh so that every vertex has one place in the texture."""
    rows = len(covered)
    farthest = float(np.nanmax(corners[:, :, 1], initial=0.0))
    repeated = min(max(int(np.ceil(farthest + 0.5)) - 2 * rows + 1, 0), 2 * rows)
    laid = lay(corners, faces, Sheet(rows, repeated))
    return Skin(
        rows=rows,
        repeated=repeated,
        origin=laid.origin,
        faces=laid.faces,
        coordinates=laid.coordinates,
        chart=chart,
        pixel_face=face,
        pixel_weights=weights,
        covered=covered,
    )


def lay(corners: Floats, faces: Ints, sheet: Sheet) -> Laid:
    """Lay a texture on a mesh, which is cut so that every vertex has one place in it.

    Parameters
    ----------
    corners : ndarray, (m, 3, 2)
        (v, u) of every corner as :func:`.files.texture.texture_corners` gives them; those of
        faces without an image, or beyond the texture, are changed in place.
    faces : ndarray, (m, 3)
    sheet : Sheet
    """
    rows, width = sheet.shape
    without = ~(corners[:, :, 1] <= width - 1.5).all(axis=1)
    corners[without] = (0.0, width - 1.0)
    origin, cut = _cut(faces, corners)
    places = np.zeros((len(origin), 2))
    places[cut.ravel()] = corners.reshape(-1, 2)
    coordinates = (places[:, ::-1] + 0.5) / (width, rows)
    coordinates[:, 1] = 1.0 - coordinates[:, 1]
    return Laid(rows, sheet.repeated, origin, cut, coordinates.astype(np.float32))


def _cut(faces: Ints, corners: Floats) -> tuple[Ints, Ints]:
    """Give every vertex as many copies as it has places.

    Returns
    -------
    origin : ndarray, (p,) int64
        The vertex that each is a copy of; the first n are the vertices themselves.
    cut : ndarray, (m, 3) int64
        The faces with copies.
    """
    size = int(faces.max()) + 1
    first = np.full((size, 2), np.nan)
    first[faces.ravel()[::-1]] = corners.reshape(-1, 2)[::-1]
    other = (corners != first[faces]).any(axis=2)
    vertex, place = faces[other], corners[other]
    keys = np.column_stack([vertex.astype(np.float64), place])
    unique, number = np.unique(keys, axis=0, return_inverse=True)
    cut = faces.copy()
    cut[other] = size + number.ravel()
    return np.concatenate([np.arange(size), unique[:, 0].astype(np.int64)]), cut


@dataclass(eq=False)
class _Covering:
    labels: npt.NDArray[np.integer]
    colours: npt.NDArray[np.float32]
    visible: bool

    def shown(self, size: int) -> npt.NDArray[np.float32]:
        """The colours of so many labels; those without one have the last."""
        labels = np.minimum(np.arange(size), len(self.colours) - 1)
        return self.colours[labels] * np.float32(self.visible)


def _table(colours: Mapping[int, npt.ArrayLike]) -> npt.NDArray[np.float32]:
    """(k, 4) by the label; 0 is transparent."""
    table = np.zeros((max([0, *colours]) + 1, 4), np.float32)
    for label, colour in colours.items():
        table[label] = colour
    table[0] = 0.0
    return table


class PaintedTexture:
    """The pixels of a texture: a field's colours, and the annotations over it.

    Parameters
    ----------
    skin : Sheet
    """

    def __init__(self, skin: Sheet) -> None:
        self._skin = skin
        self._columns = 2 * skin.rows
        self._base = np.full((skin.rows * self._columns, 3), 255, np.uint8)
        self._coverings: dict[str, _Covering] = {}
        self._dirty: Box | None = None
        #: (N, columns, 3) uint8, changed in place.
        self.pixels: Colours = np.empty((*skin.shape, 3), np.uint8)
        self.pixels[:, -1] = WITHOUT_IMAGE
        self._all()

    @property
    def names(self) -> tuple[str, ...]:
        """The annotations over the field, the lowest first."""
        return tuple(self._coverings)

    def set_field(
        self, values: Floats, table: Colours, limits: tuple[float, float], gamma: float = 1.0
    ) -> None:
        """Show a field below the annotations.

        Parameters
        ----------
        values : ndarray, (N, 2N)
            NaN is grey.
        table : ndarray, (k, 3) uint8
            A colormap from its lower to its upper end.
        limits : (float, float)
            The values at its ends.
        gamma : float
        """
        low, high = limits
        known = np.isfinite(values)
        share = np.clip((values - low) / max(high - low, 1e-300), 0.0, 1.0)
        place = np.where(known, share, 0.0) ** gamma * (len(table) - 1)
        colours = table[(place + 0.5).astype(np.int64)]
        colours[~known] = WITHOUT_IMAGE
        self._base = colours.reshape(-1, 3)
        self._all()

    def cover(
        self,
        name: str,
        labels: npt.NDArray[np.integer],
        colours: Mapping[int, npt.ArrayLike],
        visible: bool = True,
    ) -> None:
        """Show an annotation, or show it anew.

        Parameters
        ----------
        name : str
        labels : ndarray, (N, 2N)
            0 is transparent.
        colours : mapping of int to (4,)
            Red, green, blue and opacity 0…1 of every label there is.
        visible : bool
        """
        before = self._coverings.get(name)
        now = _Covering(np.array(labels).ravel(), _table(colours), visible)
        self._coverings[name] = now
        shown = [each.labels > 0 for each in (before, now) if each is not None and each.visible]
        if shown:
            self._show_pixels(np.flatnonzero(np.logical_or.reduce(shown)))

    def recolour(self, name: str, colours: Mapping[int, npt.ArrayLike], visible: bool) -> None:
        """Show an annotation in other colours, or hide it: only what differs is drawn."""
        before = self._coverings[name]
        now = _Covering(before.labels, _table(colours), visible)
        self._coverings[name] = now
        size = max(len(before.colours), len(now.colours))
        differs = (before.shown(size) != now.shown(size)).any(axis=1)
        if differs.any():
            self._show_pixels(np.flatnonzero(differs[np.minimum(now.labels, size - 1)]))

    def uncover(self, name: str) -> None:
        """Take an annotation away."""
        before = self._coverings.pop(name, None)
        if before is not None and before.visible:
            self._show_pixels(np.flatnonzero(before.labels))

    def change(self, name: str, pixels: Ints, values: npt.ArrayLike) -> None:
        """Give some pixels of an annotation other labels.

        Parameters
        ----------
        name : str
        pixels : ndarray, (k,)
            Flat indices into (N, 2N).
        values : array-like, (k,) or scalar
        """
        if name not in self._coverings or len(pixels) == 0:
            return
        covering = self._coverings[name]
        covering.labels[pixels] = values
        if covering.visible:
            self._show_pixels(pixels)

    def _show_pixels(self, pixels: Ints) -> None:
        """Draw some pixels anew, and remember where they are."""
        if len(pixels) == 0:
            return
        row, column = np.divmod(pixels, self._columns)
        self._show(pixels, row, column)
        box = Box(int(row.min()), int(row.max()) + 1, int(column.min()), int(column.max()) + 1)
        self._dirty = box if self._dirty is None else _joined(self._dirty, box)

    def take_changed(self) -> list[Box]:
        """Boxes of the texture that changed since the last call."""
        box, self._dirty = self._dirty, None
        if box is None:
            return []
        boxes = [box]
        last = min(box.last_column, self._skin.repeated)
        if box.first_column < last:
            first = self._columns + box.first_column
            boxes.append(Box(box.first_row, box.last_row, first, self._columns + last))
        return boxes

    def _all(self) -> None:
        colour = self._base.astype(np.float32)
        self._lay_over(colour, slice(None))
        shown = (colour + 0.5).astype(np.uint8).reshape(self._skin.rows, self._columns, -1)
        self.pixels[:, : self._columns] = shown
        repeated = self._skin.repeated
        self.pixels[:, self._columns : self._columns + repeated] = shown[:, :repeated]
        self._dirty = Box(0, self._skin.rows, 0, self._columns)

    def _show(self, pixels: Ints, row: Ints, column: Ints) -> None:
        colour = self._base[pixels].astype(np.float32)
        self._lay_over(colour, pixels)
        shown = (colour + 0.5).astype(np.uint8)
        self.pixels[row, column] = shown
        again = column < self._skin.repeated
        self.pixels[row[again], column[again] + self._columns] = shown[again]

    def _lay_over(self, colour: npt.NDArray[np.float32], pixels: Ints | slice) -> None:
        """Lay the visible annotations over the colours (k, 3) of some pixels."""
        for covering in self._coverings.values():
            if covering.visible:
                labels = covering.labels[pixels]
                drawn = np.flatnonzero(labels)
                over = covering.colours[np.minimum(labels[drawn], len(covering.colours) - 1)]
                opacity = COVER * over[:, 3:]
                colour[drawn] += opacity * (255.0 * over[:, :3] - colour[drawn])


def _joined(one: Box, other: Box) -> Box:
    return Box(
        min(one.first_row, other.first_row),
        max(one.last_row, other.last_row),
        min(one.first_column, other.first_column),
        max(one.last_column, other.last_column),
    )
