"""A pipeline with the real one's interface that gives a round cell at once."""

from __future__ import annotations

import gc
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from napari_unwrap3d import load_movie
from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.parameters import Parameters
from napari_unwrap3d.pipeline import ON_REQUEST, STEP_NAMES, Kept
from napari_unwrap3d.progress import Progress
from napari_unwrap3d.viewer.common.threads import QuietCollector, quiet_collector
from synthetic import make_atlas
from viewer.hand import Hand
from viewer.opened import coarsely_direct
from viewer.playing import Projector, make_movie
from viewer.tracked import OTHER, SHOWN, Tracked, wandering

EVERY_CHART = ("mask", "surface", "sealed", "reference", "sphere", "uv", "topography")
ON_REQUEST_NAMES = tuple(step.name for step in ON_REQUEST)


class FakePipeline:
    """Walks through the steps and remembers which of them it computed.

    `behaviour` maps a step to what happens in it: an exception to raise, or a number
    of seconds to take. Charts outside of `charts` are left out of the atlas: napari
    needs long to add a layer.
    """

    made: list[FakePipeline]
    behaviour: dict[str, Any]
    atlas: Atlas
    charts: tuple[str, ...]

    def __init__(self, source: Any) -> None:
        self.source = source
        self.kept: dict[str, Kept] = {}
        self.computed: list[list[str]] = []
        self.threads: set[str] = set()
        self.made.append(self)

    def run(
        self,
        parameters: Parameters,
        progress: Progress | Callable[..., None] | None = None,
        until: str = "topography",
    ) -> Atlas:
        assert isinstance(progress, Progress)
        computed: list[str] = []
        self.threads.add(threading.current_thread().name)
        for step, key in self._wanted(parameters, until).items():
            if step in self.kept and self.kept[step].key == key:
                continue
            self._compute(step, progress.named(step))
            if not computed:
                self.computed.append(computed)
            computed.append(step)
            name = "mask" if step == "stack" else step
            chart = replace(getattr(self.atlas, name)) if name in self.charts else None
            self.kept[step] = Kept(key, chart, dict(self.atlas.quality.get(step, {})), 0.25)
        missing = {name: None for name in EVERY_CHART if name not in self.charts}
        return self.atlas.replaced(**missing)

    def state(self, parameters: Parameters) -> dict[str, str]:
        states = {}
        for step, key in self._wanted(parameters).items():
            if step in ON_REQUEST_NAMES and not self._asked(step, parameters):
                continue
            kept = self.kept.get(step)
            states[step] = "missing" if kept is None else "done" if kept.key == key else "stale"
        return states

    @property
    def results(self) -> dict[str, Any]:
        return {s: kept.value for s, kept in self.kept.items() if kept.value is not None}

    def _compute(self, step: str, progress: Progress) -> None:
        what = self.behaviour.get(step, 0.0)
        if isinstance(what, Exception):
            raise what
        stop = time.monotonic() + what
        progress(0.0, f"computing {step}")
        while time.monotonic() < stop:
            progress(0.5, f"still computing {step}")
            time.sleep(0.01)
        progress(1.0)

    def _asked(self, step: str, parameters: Parameters) -> bool:
        return step in self.kept or getattr(parameters, step).compute

    @staticmethod
    def _wanted(parameters: Parameters, until: str = "") -> dict[str, str]:
        """Keys of the steps up to one; by default of all, those on request included."""
        wanted, key = {}, ""
        groups = parameters.model_dump(exclude={name: {"compute"} for name in ON_REQUEST_NAMES})
        for step in STEP_NAMES:
            key += str(groups.get(step, ""))
            wanted[step] = key
            if step == until and step != STEP_NAMES[-1]:
                return wanted
        for step in ON_REQUEST_NAMES:
            if not until or getattr(parameters, step).compute:
                wanted[step] = key + str(groups[step])
        return wanted


@pytest.fixture
def real_collector() -> None:
    """For tests of the quiet collector: nothing is left out of collections beforehand."""
    gc.unfreeze()


@pytest.fixture(autouse=True)
def collect_what_is_new(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> Iterator[None]:
    """Let collections look at what this test makes only.

    napari looks for leaks with a full collection after every window, and the objects of all
    the modules and shared atlases would take most of the suite's time. The quiet collector,
    which would put all of them back, only counts who holds it.
    """
    if "real_collector" in request.fixturenames:
        yield
        return
    gc.collect()
    gc.freeze()
    for name in ("_begin", "_end", "renew"):
        monkeypatch.setattr(QuietCollector, name, lambda collector: None)
    yield
    assert not quiet_collector._holders, "a window that is gone holds the collector"


@pytest.fixture(scope="session")
def round_cell() -> Atlas:
    return make_atlas()


@pytest.fixture
def fake_pipeline(round_cell: Atlas, monkeypatch: pytest.MonkeyPatch) -> type[FakePipeline]:
    """The class that stands in for the pipeline while a test runs."""

    fields = {
        name: round_cell.uv.fields[name]
        for name in ("mean_curvature_per_um", "surface_mean_curvature_per_um")
    }

    class Pipeline(FakePipeline):
        made: list[FakePipeline] = []  # noqa: RUF012 (one list per test is meant)
        behaviour: dict[str, Any] = {}  # noqa: RUF012
        charts = ("mask", "surface", "reference", "sphere")
        atlas = replace(round_cell, uv=replace(round_cell.uv, fields=fields))

    monkeypatch.setattr("napari_unwrap3d.viewer.steps.computing.Pipeline", Pipeline)
    return Pipeline


@pytest.fixture
def every_chart(fake_pipeline: type[FakePipeline]) -> None:
    """Let the pipeline make every chart."""
    fake_pipeline.charts = EVERY_CHART


@pytest.fixture
def errors(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What the user was told in notifications of errors."""
    from napari.utils.notifications import notification_manager

    told: list[str] = []

    def remember(notification: Any) -> None:
        told.append(str(notification.message))

    monkeypatch.setattr(notification_manager, "dispatch", remember)
    return told


@pytest.fixture
def stack() -> np.ndarray:
    """A bright ball in noise, (z, y, x) uint8."""
    z, y, x = np.ogrid[-1:1:16j, -1:1:24j, -1:1:24j]
    noise = np.random.default_rng(0).integers(0, 20, (16, 24, 24))
    return (200 * (z**2 + y**2 + x**2 < 0.5) + noise).astype(np.uint8)


@pytest.fixture(scope="session")
def direct_atlas(small_atlas: Any) -> Any:
    """The small cell with its direct chart, as small as the uv image."""
    return coarsely_direct(small_atlas)


@pytest.fixture
def hand(make_napari_viewer: Any, direct_atlas: Any, qtbot: Any) -> Hand:
    return Hand(make_napari_viewer(show=True), direct_atlas.replaced(), qtbot)


@pytest.fixture(scope="session")
def upright_atlas(small_pipeline: Any) -> Atlas:
    """The small cell with its axis set by hand: the last bits of a number may turn a found one."""
    from napari_unwrap3d.pipeline import Pipeline
    from shapes import QUICK

    groups = QUICK.model_dump()
    groups["uv"]["axis_zyx"] = (1.0, 0.2, -0.3)
    groups["direct"]["rows"] = 64
    pipeline = Pipeline(small_pipeline.source, dict(small_pipeline.kept))
    return pipeline.run(Parameters.from_dict(groups), until="direct")


@pytest.fixture(scope="session")
def movie_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small movie with all of its frames; copy it to change it."""
    folder = tmp_path_factory.mktemp("movies") / "breathing"
    make_movie(folder)
    return folder


@pytest.fixture
def movie_copy(movie_folder: Path, tmp_path: Path) -> Path:
    """A copy of the movie, which may be changed."""
    return Path(shutil.copytree(movie_folder, tmp_path / "movie"))


@pytest.fixture
def projector(make_napari_viewer: Any, movie_folder: Path, tmp_path: Path, qtbot: Any) -> Projector:
    """A window that shows a copy of the movie."""
    folder = shutil.copytree(movie_folder, tmp_path / "movie")
    return Projector(make_napari_viewer(show=True), load_movie(folder), qtbot)


@pytest.fixture
def tracked(make_napari_viewer: Any, movie_folder: Path, tmp_path: Path, qtbot: Any) -> Tracked:
    """A window that shows a copy of the movie, with tracks that were kept with it."""
    movie = load_movie(shutil.copytree(movie_folder, tmp_path / "movie"))
    tracks = wandering(movie)
    movie.keep_tracks(OTHER, tracks.kept([1]))
    movie.keep_tracks(SHOWN, tracks)
    return Tracked(make_napari_viewer(show=True), movie, qtbot)
