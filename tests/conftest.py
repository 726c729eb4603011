"""What all tests share."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

if TYPE_CHECKING:
    from napari_unwrap3d.atlas import Atlas
    from napari_unwrap3d.motion.movie import Movie
    from napari_unwrap3d.pipeline import Pipeline

PROJECT = Path(__file__).resolve().parents[1]

# The same examples in every run, and no limit on time: the first call of a kernel compiles it.
settings.register_profile("house", deadline=None, derandomize=True)
settings.load_profile("house")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real stacks and meshes beside the project, where there is one."""
    folder = PROJECT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("the real data are not beside the project")
    return folder


@pytest.fixture(scope="session")
def small_pipeline() -> Pipeline:
    """A pipeline that has unwrapped the small cell of tests/shapes.py; do not run it."""
    from napari_unwrap3d.pipeline import Pipeline
    from shapes import QUICK, small_cell_mask

    pipeline = Pipeline(small_cell_mask())
    pipeline.run(QUICK)
    return pipeline


@pytest.fixture(scope="session")
def small_atlas(small_pipeline: Pipeline) -> Atlas:
    """The atlas of the small cell."""
    from shapes import QUICK

    return small_pipeline.run(QUICK)


@pytest.fixture(scope="session")
def handle_atlas() -> Atlas:
    """The atlas of the small cell with a handle."""
    from napari_unwrap3d.pipeline import unwrap
    from shapes import QUICK, small_cell_mask

    return unwrap(small_cell_mask(handle=True), QUICK)


@pytest.fixture(scope="session")
def plane_atlas(small_pipeline: Pipeline) -> Atlas:
    """The atlas of the small cell with its plane."""
    from napari_unwrap3d.pipeline import Pipeline
    from shapes import QUICK

    return Pipeline(small_pipeline.source, dict(small_pipeline.kept)).run(QUICK, until="plane")


@pytest.fixture(scope="session")
def plane_handle_atlas() -> Atlas:
    """The atlas of the small cell with a handle with its plane."""
    from napari_unwrap3d.pipeline import Pipeline
    from shapes import QUICK, small_cell_mask

    return Pipeline(small_cell_mask(handle=True)).run(QUICK, until="plane")


@pytest.fixture(scope="session")
def breathing(tmp_path_factory: pytest.TempPathFactory) -> Movie:
    """The movie of tests/movies.py with all of its frames; change nothing in its folder."""
    from movies import breathing_movie

    return breathing_movie(tmp_path_factory.mktemp("movies") / "breathing")
