"""Protrusions edited by a person: merged, split, deleted, painted; measured for what changed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ..charts import Floats, Ints, Protrusions, Volume
from ..errors import ParameterError
from ..geometry.mesh import edges_with_faces
from ..geometry.peaks import around_peaks, around_seeds, mesh_graph
from .ownership import Ownership
from .segment import Segmentation
from .solid_measures import AROUND
from .table import measure_protrusions, parts_against_whole, present, replaced_rows

if TYPE_CHECKING:
    from ..annotations import Annotations
    from ..atlas import Atlas
    from ..pipeline import Pipeline

Labels = npt.NDArray[np.int32]

NAME = "protrusions"
EDITED = "edited"


class ProtrusionEdits:
    """Edits of the protrusions of an atlas, which can be undone.

    The labels are the annotation :data:`NAME` of ``atlas.annotations``: they are painted,
    erased, undone and shown on every chart like any other, and every method here is one stroke
    of it. The volume follows the labels of the vertices (:class:`.ownership.Ownership`), so
    that the same labels give the same protrusions, however they came about.

    Parameters
    ----------
    atlas : Atlas
        Its protrusions are computed unless they were.
    """

    def __init__(self, atlas: Atlas) -> None:
        self._atlas = atlas
        self._base = atlas.protrusions
        self._now = self._base

    # What there is -----------------------------------------------------------------

    @property
    def annotations(self) -> Annotations:
        """Where the labels are, with undo and redo."""
        return self._atlas.annotations

    @property
    def started(self) -> bool:
        """Whether the labels are in the annotation."""
        return NAME in self.annotations.names

    def start(self, *, anew: bool = False) -> None:
        """Put the labels that were found into the annotation, in one stroke.

        One that is there already stays as it is, unless it is to be started `anew`.
        """
        if self.started and not anew:
            return
        with self.annotations.stroke():
            if self.started:
                self.annotations.remove(NAME)
            self.annotations.add(NAME)
            self._paint(np.arange(len(self._base.labels)), self._base.labels)

    @property
    def labels(self) -> Labels:
        """One label per vertex of the surface, 0 = none, as edited so far, (n,) int32."""
        if not self.started:
            return self._base.labels
        return self.annotations.labels(NAME).astype(np.int32)

    @property
    def unused(self) -> int:
        """A label that no protrusion has or had."""
        return 1 + int(max(self.labels.max(initial=0), self._base.labels.max(initial=0)))

    # Edits -------------------------------------------------------------------------

    def merge(self, labels: Iterable[int]) -> int:
        """Make several protrusions one, with the label of the first, which is returned."""
        first, *others = self._known(labels)
        self._stroke(np.flatnonzero(np.isin(self.labels, others)), first)
        return first

    def delete(self, labels: int | Iterable[int]) -> None:
        """Give protrusions back to the cortex."""
        chosen = self._known([labels] if isinstance(labels, int | np.integer) else labels)
        self._stroke(np.flatnonzero(np.isin(self.labels, chosen)), 0)

    def add(self, vertices: npt.ArrayLike) -> int:
        """Make these vertices of the surface a protrusion, whose label is returned."""
        label = self.unused
        self._stroke(np.unique(np.asarray(vertices, np.int64)), label)
        return label

    def split(self, label: int, seeds: npt.ArrayLike | None = None, parts: int = 2) -> list[int]:
        """Make several protrusions of one.

        Parameters
        ----------
        label : int
        seeds : array-like of int, (k,) or of float, (k, 3), optional
            Vertices of the surface, or points in µm, one in each part: each vertex goes to the
            seed that is nearest along the surface. Otherwise the peaks of height that stand
            out most are parted at the saddles between them.
        parts : int
            Where there are no seeds.

        Returns
        -------
        list of int
            The labels of the parts. The first seed, or the peak that stands out most, keeps
            the label.

        Raises
        ------
        ParameterError
            There are fewer peaks than parts, or fewer than two seeds apart from each other.
        """
        return self.take_apart(*self.parts_of(label, seeds, parts))

    def parts_of(
        self, label: int, seeds: npt.ArrayLike | None = None, parts: int = 2
    ) -> tuple[Ints, Ints]:
        """What :meth:`split` would do, which takes a moment; nothing is changed.

        Returns
        -------
        vertices, labels : ndarray, (k,)
            The protrusion's vertices, and the label that each would have.
        """
        (label,) = self._known([label])
        mine = np.flatnonzero(self.labels == label)
        graph = mesh_graph(self._atlas.surface.vertices, self._edges, mine)
        if seeds is None:
            part, peaks = around_peaks(graph, self._base.height_um[mine], parts)
            if len(peaks) < max(parts, 2):
                raise ParameterError(
                    f"Protrusion {label} has fewer peaks than parts.",
                    peaks=len(peaks),
                    hint="Point at a place in each part instead.",
                )
        else:
            part = around_seeds(graph, self._nodes(mine, np.asarray(seeds)))
        unused = self.unused
        numbers = np.array([label, *range(unused, unused + int(part.max()))])
        return mine, numbers[part]

    def take_apart(self, vertices: Ints, labels: Ints) -> list[int]:
        """Give vertices their labels in one stroke; the labels are returned, in order."""
        with self.annotations.stroke():
            self.start()
            self._paint(vertices, labels)
        return [int(label) for label in np.unique(labels)]

    def _nodes(self, mine: Ints, seeds: npt.NDArray[np.generic]) -> Ints:
        """The places of seeds among the vertices of a protrusion."""
        vertices = self._atlas.surface.vertices
        points: Floats = vertices[seeds] if seeds.ndim == 1 else seeds.astype(np.float64)
        apart = np.linalg.norm(vertices[mine][None] - points[:, None], axis=2)
        nodes: Ints = apart.argmin(axis=1)
        if len(nodes) < 2 or len(np.unique(nodes)) < len(nodes):
            raise ParameterError(
                "To split a protrusion takes two places of it, at least.",
                places=len(np.unique(nodes)),
                hint="Point at a place in each part.",
            )
        return nodes

    def _known(self, labels: Iterable[int]) -> list[int]:
        """Labels, each once in their order; an error if there is no protrusion with one."""
        chosen = list(dict.fromkeys(int(label) for label in labels))
        there = set(np.unique(self.labels).tolist()) - {0}
        missing = [label for label in chosen if label not in there]
        if missing or not chosen:
            raise ParameterError(
                "There is no such protrusion.", labels=", ".join(map(str, missing)) or "none"
            )
        return chosen

    def _stroke(self, vertices: Ints, label: int) -> None:
        with self.annotations.stroke():
            self.start()
            self.annotations.draw_vertices(NAME, vertices, label)

    def _paint(self, vertices: Ints, labels: Ints | Labels) -> None:
        for label in np.unique(labels):
            self.annotations.draw_vertices(NAME, vertices[labels == label], int(label))

    # Measuring ---------------------------------------------------------------------

    @property
    def protrusions(self) -> Protrusions:
        """The protrusions as edited: measured for what changed since this was last read.

        Bit for bit what measuring everything gives. Without any change what was found.
        """
        labels = self.labels
        changed = np.flatnonzero(labels != self._now.labels)
        if len(changed):
            whole = np.array_equal(labels, self._base.labels)
            self._now = self._base if whole else self._measured(labels, changed)
        return self._now

    def keep(self, pipeline: Pipeline | None = None) -> Protrusions:
        """Put the edited protrusions in the place of those that were found, and return them.

        Parameters
        ----------
        pipeline : Pipeline, optional
            That made the atlas; it takes them for its own result.
        """
        now = self.protrusions
        if now is not self._atlas.protrusions:
            self._atlas.keep(NAME, now, dict(now.numbers))
        if pipeline is not None:
            pipeline.keep(NAME, now, dict(now.numbers))
        return now

    def _measured(self, labels: Labels, changed: Ints) -> Protrusions:
        before, mask = self._now, self._atlas.mask
        volume, voxels = self._ownership.relabelled(before.volume.data, labels)
        cortex = mask.data & (volume == 0)
        found = Segmentation(labels, self._base.height_um, volume, cortex)
        there = present(found)
        affected = self._affected(before, found, changed, voxels)
        again, gone = np.intersect1d(affected, there), np.setdiff1d(affected, there)
        image, rows = self._image
        fresh = measure_protrusions(found, mask, self._atlas.surface, image, rows=rows, only=again)
        columns = replaced_rows(before.columns, fresh, gone)
        return replace(
            before,
            labels=labels,
            volume=Volume(volume, mask.voxel_size, mask.origin),
            cortex=replace(mask, data=cortex),
            columns=columns,
            method=EDITED,
            numbers={
                **self._base.numbers,
                "method": EDITED,
                "protrusions": len(there),
                **parts_against_whole(found, mask),
            },
        )

    def _affected(
        self, before: Protrusions, found: Segmentation, vertices: Ints, voxels: Ints
    ) -> Ints:
        """The labels whose measures may be others: they, or what is around them, changed."""
        moved = np.zeros(len(found.labels), bool)
        moved[vertices] = True
        around = self._edges[moved[self._edges].any(axis=1)].ravel()
        labels = [before.labels[around], found.labels[around]]
        labels += [before.labels[vertices], found.labels[vertices]]
        labels += [before.volume.data.ravel()[voxels], found.volume.ravel()[voxels]]
        affected = np.unique(np.concatenate(labels).astype(np.int64))
        near = _boxes_over(found.volume, voxels)
        return np.setdiff1d(np.union1d(affected, near), [0])

    @cached_property
    def _ownership(self) -> Ownership:
        return Ownership.of(self._base, self._atlas.surface)

    @cached_property
    def _edges(self) -> Ints:
        return edges_with_faces(self._atlas.surface.faces).vertices

    @property
    def _image(self) -> tuple[Floats, int | None]:
        """The surface in (d, v, u), and the rows of the image."""
        if not self._atlas.has("topography"):
            return np.full((len(self._base.labels), 3), np.nan), None
        chart = self._atlas.topography
        return chart.surface, int(chart.shape[1])


def _boxes_over(volume: Labels, voxels: Ints) -> Ints:
    """The labels in whose surroundings, as far as they are measured, these voxels (flat) lie."""
    places = np.stack(np.unravel_index(voxels, volume.shape), axis=1)
    found = []
    for number, box in enumerate(ndimage.find_objects(volume), start=1):
        if box is not None:
            low = [part.start - AROUND for part in box]
            high = [part.stop + AROUND for part in box]
            if ((places >= low) & (places < high)).all(axis=1).any():
                found.append(number)
    return np.array(found, np.int64)
