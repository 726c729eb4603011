"""What tests of tracking share: one small movie, made once."""

from __future__ import annotations

import pytest

import napari_unwrap3d as unwrap3d
from moving import blebbing_movie


@pytest.fixture(scope="session")
def movie(tmp_path_factory: pytest.TempPathFactory) -> unwrap3d.Movie:
    """The blebbing ball; tests leave its annotations and tracks as they found them."""
    return blebbing_movie(tmp_path_factory.getbasetemp() / "blebbing")
