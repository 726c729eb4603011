"""The work on one movie, cut into pieces that can be done anywhere and in any order of time.

A piece reads what earlier pieces wrote into the movie's folder and writes one file; what is
there with the right key is not made again. :func:`~.movie.unwrap_movie` runs them one after the
other, :mod:`napari_unwrap3d.batch` on as many workers as there are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from ..annotations.state import State, moved
from ..atlas import Atlas
from ..charts import Mask, Stack, Surface, TemporalMask
from ..errors import InputError, NoMeanError
from ..files.movie import MovieFolder
from ..files.project import load_project, save_project
from ..imaging.register import Registered
from ..parameters import Parameters
from ..pipeline import STEP_VERSION, Pipeline
from ..progress import Progress, silent
from ..provenance import content_hash, environment
from ..unwrapping.solid import closed_mesh, mask_of_mesh
from .alignment import aligned_atlas, fitted, guide_of, in_order
from .common import EACH, MEAN, TIMEPOINT, Recommendation, recommend
from .frames import CommonSpace, frame_at, frame_of
from .outlines import MeanOutline, moved_surface, outline
from .registering import SEEN_BY_REGISTRATION, register_channels, register_timepoint, unmoved
from .timelapse import Source, Timelapse

Stage = Literal["register", "segment", "common", "frame"]
PER_TIMEPOINT: tuple[Stage, ...] = ("register", "segment", "frame")
# The groups of parameters that the common space depends on.
SPACE = ("surface", "sealed", "reference", "sphere", "uv", "topography")


@dataclass
class MovieWork:
    """The pieces of work of one movie.

    Attributes
    ----------
    lapse : Timelapse
    parameters : Parameters
    folder : MovieFolder
    """

    lapse: Timelapse
    parameters: Parameters
    folder: MovieFolder
    _keys: dict[int, str] = field(default_factory=dict)

    def begin(self) -> None:
        """Write what the movie is of into its folder."""
        self.folder.begin(
            {
                "name": self.lapse.name,
                "timepoints": len(self.lapse),
                "time_step_s": self.lapse.time_step_s,
                "channels": list(self.lapse.channels),
                "parameters": self.parameters.to_toml(),
                "versions": environment(),
            }
        )

    def know(self, keys: Mapping[int, str]) -> None:
        """Take hashes of timepoints' sources from someone who has read them."""
        self._keys |= keys

    def known(self, timepoint: int) -> str | None:
        """The hash of a timepoint's source, if it was read."""
        return self._keys.get(timepoint)

    def run(self, stage: Stage, timepoint: int, progress: Progress) -> bool:
        """Do one piece of work; False where it was done before.

        Raises
        ------
        Unwrap3DError
            The piece could not be made; nothing is written.
        """
        done: bool = getattr(self, stage)(timepoint, progress)
        return done

    # The pieces --------------------------------------------------------------------

    def register(self, timepoint: int, progress: Progress) -> bool:
        """Find where a timepoint lies in the common world."""
        key = self.registration_key(timepoint)
        if self.folder.registered(timepoint, key) is not None:
            return False
        found = self._register(timepoint, progress)
        self.folder.keep_registered(timepoint, key, found)
        return True

    def segment(self, timepoint: int, progress: Progress) -> bool:
        """Find the cell at a timepoint, in the common world."""
        key = self.mask_key(timepoint)
        if self.folder.has_mask(timepoint, key):
            return False
        pose = self.registered(timepoint).pose
        mask, numbers = outline(self.lapse.at(timepoint), pose, self.working_parameters, progress)
        self.folder.keep_mask(timepoint, key, mask, numbers)
        return True

    def common(self, timepoint: int, progress: Progress) -> bool:
        """Build the common space of the timepoints that have a mask."""
        key = self.common_key()
        record = self.folder.common()
        if record is not None and record["key"] == key:
            return False
        segmented = self.segmented()
        which = self._chosen_timepoint(segmented)
        mean = MeanOutline.of(self._masks(progress.part(0.0, 0.05)))
        chosen = self.parameters.movie
        first, _ = self.folder.mask(which)
        temporal = self._mean_or_none(mean)
        progress(0.1, "choosing the common space")
        advice = recommend(self._masks(progress), temporal, first, chosen.largest_outside)
        method = advice.method if chosen.common == "recommended" else chosen.common
        source: Source
        if method == MEAN:
            source = temporal if temporal is not None else mean.mask()
        elif method == EACH:
            source = self._own_source(which, first)
        else:
            source = mean.placed(first)
        pipeline = Pipeline(source)
        end = 0.5 if method == EACH else 0.95
        atlas = pipeline.run(self.space_parameters, _within(progress, 0.15, end))
        kept = kept_annotations(self.folder.common_path, atlas)
        self.folder.drop_common()
        save_project(atlas, self.folder.common_path, source=source, annotations=kept)
        if method == EACH:
            self._guide(atlas, which, segmented, key, progress.part(end, 0.95))
        advice = advice.spread(segmented, len(self.lapse))
        self.folder.keep_common(_record(key, method, which, mean.timepoints, advice))
        return True

    def frame(self, timepoint: int, progress: Progress) -> bool:
        """Bring a timepoint into the common space."""
        key = self.frame_key(timepoint)
        if self.folder.has_frame(timepoint, key):
            return False
        source = self.lapse.at(timepoint)
        registered = self.registered(timepoint)
        mask, _ = self.folder.mask(timepoint)
        record = self.folder.common()
        stack = source if isinstance(source, Stack) else None
        time_s = float(self.lapse.times_s[timepoint])
        at = (stack, registered, timepoint, time_s, self.working_parameters)
        if record is not None and record["method"] == EACH:
            own = self._own_atlas(timepoint, mask, record, progress.part(0.0, 0.8))
            cell, image = own.surface, own.topography.surface
            frame = frame_at(CommonSpace(own), cell, image, mask, *at, progress.part(0.8, 1.0))
        else:
            frame = frame_of(self.space, mask, self._given(timepoint), *at, progress)
        self.folder.keep_frame(frame, key)
        return True

    # An atlas for each timepoint ---------------------------------------------------

    def _guide(
        self, atlas: Atlas, which: int, segmented: list[int], key: str, progress: Progress
    ) -> None:
        """Bring the guide to one timepoint after the other, of those that have a mask."""
        mask, _ = self.folder.mask(which)
        guide = guide_of(mask, atlas.reference, atlas.sphere)
        self.folder.keep_guide(which, key, guide)
        for done, (timepoint, before) in enumerate(in_order(segmented, which)):
            if self.folder.guide(timepoint, key) is not None:
                continue
            size = len(segmented)
            part = progress.part(done / size, (done + 1) / size)
            found = self.folder.guide(before, key)
            assert found is not None
            mask, _ = self.folder.mask(timepoint)
            self.folder.keep_guide(timepoint, key, fitted(found, mask, part))

    def _own_atlas(
        self, timepoint: int, mask: Mask, record: Mapping[str, Any], progress: Progress
    ) -> Atlas:
        """The atlas of a timepoint, its sphere aligned with the common one; kept in its file."""
        source = self._own_source(timepoint, mask)
        atlas = self.space.atlas
        if timepoint != record["timepoint"]:
            guide = self.folder.guide(timepoint, record["key"])
            assert guide is not None
            report = _within(progress, 0.0, 0.9, "atlas")
            atlas = aligned_atlas(source, guide, atlas, self.space_parameters, report)
        save_project(atlas, self.folder.atlas_path(timepoint), source=source)
        return atlas

    def _own_source(self, timepoint: int, mask: Mask) -> Mask | Surface:
        """What a timepoint is unwrapped from: its mesh, or else its mask."""
        given = self._given(timepoint)
        return mask if given is None else given

    def _given(self, timepoint: int) -> Surface | None:
        """The mesh of a timepoint in the common world, where it was given as one."""
        source = self.lapse.at(timepoint)
        if not isinstance(source, Surface):
            return None
        return moved_surface(closed_mesh(source), self.registered(timepoint).pose)

    # What the pieces need ----------------------------------------------------------

    def registered(self, timepoint: int) -> Registered:
        """Where a timepoint lies; found now if it was not."""
        key = self.registration_key(timepoint)
        found = self.folder.registered(timepoint, key)
        if found is None:
            self.register(timepoint, silent())
            found = self.folder.registered(timepoint, key)
        assert found is not None
        return found

    @cached_property
    def working_parameters(self) -> Parameters:
        """With one working voxel for all timepoints."""
        first = self.lapse.at(0)
        if self.parameters.stack.working_voxel_um is not None or not isinstance(first, Surface):
            return self.parameters
        edge = mask_of_mesh(closed_mesh(first), None)[0].voxel_size[0]
        stack = self.parameters.stack.model_copy(update={"working_voxel_um": edge})
        return self.parameters.model_copy(update={"stack": stack})

    @property
    def space_parameters(self) -> Parameters:
        """Those of the atlas of the common space, whose source is no image."""
        edge = self.working_parameters.stack.working_voxel_um
        # A mask has its working voxels already.
        mesh = isinstance(self.lapse.at(0), Surface)
        stack = type(self.parameters.stack)(working_voxel_um=edge if mesh else None)
        # Protrusions are those of a timepoint, not of the common space.
        protrusions = self.parameters.protrusions.model_copy(update={"compute": False})
        return self.parameters.model_copy(update={"stack": stack, "protrusions": protrusions})

    @property
    def space(self) -> CommonSpace:
        """The common space that the folder holds."""
        record = self.folder.common()
        if record is None:
            raise InputError(
                "The movie has no common space yet.", hint="Run the stage 'common' before."
            )
        kept: tuple[str, CommonSpace] | None = self.__dict__.get("_space")
        if kept is None or kept[0] != record["key"]:
            kept = (record["key"], CommonSpace(load_project(self.folder.common_path)))
            self.__dict__["_space"] = kept
        return kept[1]

    def _masks(self, progress: Progress) -> Iterable[Mask]:
        segmented = self.segmented()
        for done, timepoint in enumerate(segmented):
            progress(done / len(segmented), "the cell at all timepoints")
            yield self.folder.mask(timepoint)[0]

    def segmented(self) -> list[int]:
        """The timepoints that have a mask: in a batch, one that fails does not stop the others."""
        every = range(len(self.lapse))
        return [t for t in every if self.folder.has_mask(t, self.mask_key(t))]

    @staticmethod
    def _mean_or_none(mean: MeanOutline) -> TemporalMask | None:
        try:
            return mean.mask()
        except NoMeanError:
            return None

    def _chosen_timepoint(self, segmented: list[int]) -> int:
        which = self.parameters.movie.timepoint
        self.lapse.at(which)
        if which in segmented:
            return which
        if not segmented or self.parameters.movie.common == TIMEPOINT:
            raise InputError(
                f"The cell was not found at timepoint {which}, which makes the common space.",
                segmented=len(segmented),
                hint="Choose another timepoint (movie.timepoint), or look why it failed.",
            )
        return min(segmented, key=lambda timepoint: abs(timepoint - which))

    def _register(self, timepoint: int, progress: Progress) -> Registered:
        chosen = self.parameters.registration
        this = self.lapse.at(timepoint)
        registered = unmoved(chosen)
        if chosen.method != "none" and timepoint > 0:
            first, part = self.lapse.at(0), progress.part(0.0, 0.7)
            registered = register_timepoint(first, this, self.working_parameters, part)
        if not (chosen.channels and isinstance(this, Stack)):
            return registered
        if chosen.channel_timepoints == "first" and timepoint > 0:
            return registered.with_channels_of(self.registered(0))
        part = progress.part(0.7, 1.0)
        return register_channels(this, registered, self.working_parameters, part)

    # Keys --------------------------------------------------------------------------

    def source_key(self, timepoint: int) -> str:
        """Hash of a timepoint's source."""
        if timepoint not in self._keys:
            self._keys[timepoint] = self.lapse.key(timepoint)
        return self._keys[timepoint]

    def registration_key(self, timepoint: int) -> str:
        registration = self.parameters.registration.model_dump_json()
        sources = [self.source_key(t) for t in (0, timepoint)]
        seen = self.working_parameters.stack.model_dump_json(include=SEEN_BY_REGISTRATION)
        return self._key("register", registration, seen, sources)

    def mask_key(self, timepoint: int) -> str:
        stack = self.working_parameters.stack.model_dump_json(exclude={"timepoint"})
        return self._key("segment", stack, self.registration_key(timepoint))

    def common_key(self) -> str:
        chosen = self.parameters.movie
        how = (chosen.common, chosen.timepoint, chosen.largest_outside)
        steps = [getattr(self.parameters, name).model_dump_json() for name in SPACE]
        masks = [(t, self.mask_key(t)) for t in self.segmented()]
        return self._key("common", how, steps, masks)

    def frame_key(self, timepoint: int) -> str:
        """Of the space that is there: where it is made anew, frames are stale."""
        record = self.folder.common() or {}
        surface = self.parameters.surface.model_dump_json()
        movie = self.parameters.movie.model_dump_json(exclude={"common", "largest_outside"})
        return self._key("frame", record.get("key"), surface, movie, self.mask_key(timepoint))

    @staticmethod
    def _key(stage: str, *parts: Any) -> str:
        return content_hash(STEP_VERSION, stage, *parts)


def stages(timepoints: int) -> Iterable[tuple[Stage, range]]:
    """Stages in order, and the timepoints of each; those of one stage are independent."""
    yield "register", range(timepoints)
    yield "segment", range(timepoints)
    yield "common", range(1)
    yield "frame", range(timepoints)


def kept_annotations(path: Path, atlas: Atlas) -> State | None:
    """What was drawn on the common space in a file, as it is to be on one that replaces it."""
    if not path.is_file():
        return None
    before = load_project(path)
    if before.annotated is None or not before.annotations.names:
        return None
    return moved(before.annotations, atlas)


def _record(
    key: str, method: str, timepoint: int, timepoints: int, advice: Recommendation
) -> dict[str, Any]:
    return {
        "key": key,
        "method": method,
        "timepoint": timepoint if method in (TIMEPOINT, EACH) else None,
        "timepoints": timepoints,
        "recommendation": advice.to_plain(),
    }


def _within(
    progress: Progress, start: float, stop: float, what: str = "common space"
) -> Callable[[str, float, str], None]:
    """The progress of a pipeline's steps as that of a part of one piece of work."""
    names = [*SPACE, "stack"]

    def report(step: str, fraction: float, message: str) -> None:
        place = names.index(step) if step in names else 0
        done = (place + fraction) / len(names)
        progress(start + (stop - start) * done, f"{what}, {step}: {message}")

    return report
