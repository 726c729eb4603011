"""A movie that was read, ready to be shown; no window is needed for it."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ...charts import Size3
from ...errors import InputError
from ...motion.movie import Movie
from ..files.project import Opened, read_opened
from .sources import SPACE_LAYER

SPACE_NAME = "common space"


@dataclass(frozen=True, eq=False)
class OpenedMovie:
    """A movie and its common space with the layers of it.

    Attributes
    ----------
    movie : Movie
    space : Opened
        Its atlas is the movie's ``common``.
    """

    movie: Movie
    space: Opened


def read_movie(movie: Movie, origin: Size3 | None = None) -> OpenedMovie:
    """Read the common space of a movie: what takes long, to be done in a thread.

    Parameters
    ----------
    movie : Movie
    origin : (float, float, float), optional
        Where it lies in the viewer, (z, y, x) in µm; by default what the file says.

    Raises
    ------
    Unwrap3DError
        There is no common space yet, or it cannot be read.
    """
    movie.folder.manifest()
    parameters = movie.parameters if movie.work is None else movie.work.parameters
    if movie.folder.common() is None:
        raise InputError(
            "The movie has no common space yet.",
            hint="Run `napari-unwrap3d batch` on the source to make what is missing.",
        )
    space = read_opened(movie.folder.common_path, None, parameters, origin)
    # One atlas for all: what is drawn on it, and what is computed of it, is the movie's.
    movie.use_common(space.atlas)
    data, attributes, kind = space.source_layer
    attributes = {**attributes, "name": SPACE_NAME, "metadata": {SPACE_LAYER: True}}
    return OpenedMovie(movie, replace(space, source_layer=(data, attributes, kind)))
