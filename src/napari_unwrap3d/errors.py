"""Errors that say what is wrong, the number that was measured, and the way out.

Every error of this package derives from :class:`Unwrap3DError`. The message of
an error is built from three parts: what is wrong, the measured numbers, and a
hint that tells the user what to do about it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


class Unwrap3DError(Exception):
    """Base of all errors of this package.

    Parameters
    ----------
    message : str
        What is wrong, in one sentence.
    hint : str
        What the user can do about it.
    **measured
        The numbers behind the message, e.g. ``genus=3``; kept in
        :attr:`measured` and printed in the message.
    """

    default_message = "Something went wrong."

    def __init__(self, message: str = "", *, hint: str = "", **measured: Any) -> None:
        self.what = message or self.default_message
        self.hint = hint
        self.measured = measured
        numbers = ", ".join(f"{key} = {_short(value)}" for key, value in measured.items())
        parts = [self.what, f"Measured: {numbers}." if numbers else "", hint]
        super().__init__(" ".join(part for part in parts if part))


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


class Cancelled(Unwrap3DError):
    """The user asked the computation to stop."""

    default_message = "Cancelled."


# Input -----------------------------------------------------------------------


class InputError(Unwrap3DError, ValueError):
    """The input cannot be used as it is."""


class AxesError(InputError):
    """The number or the names of the axes do not fit."""


class NoMeanError(InputError):
    """The timepoints of a movie have too little in common for a mean."""


class VoxelSizeMissingError(InputError):
    """No voxel size is known, and it is never guessed."""


class FileFormatError(InputError):
    """A file is truncated, damaged, or of a kind that is not read."""


class SchemaError(FileFormatError):
    """A project is of a schema that this version does not read."""


class UnsafeFileError(FileFormatError):
    """A file names or declares what it must not: it is damaged, or made to do harm."""


class NotFiniteError(InputError):
    """NaN or infinite values in the input."""


class EmptyMaskError(InputError):
    """The mask or the segmentation contains no voxel."""


class FullMaskError(InputError):
    """The mask or the segmentation contains every voxel."""


class SeveralCellsError(InputError):
    """More than one cell-sized object: which one is meant?"""


class TouchesBorderError(InputError):
    """The cell is cut by the border of the image."""


class TooSmallError(InputError):
    """The object is too small to be unwrapped at this voxel size."""


class ParameterError(Unwrap3DError, ValueError):
    """A parameter is unknown or out of its range."""


# Meshes ----------------------------------------------------------------------


class MeshError(InputError):
    """A mesh is not what the step needs."""


class NotWatertightError(MeshError):
    """The mesh has boundary edges."""


class NotManifoldError(MeshError):
    """An edge belongs to more than two faces, or a vertex to two fans."""


class NotGenusZeroError(MeshError):
    """The mesh has handles, so it is no topological sphere."""


class NotADiskError(MeshError):
    """The mesh has handles, or not exactly one border, so it is no topological disk."""


# Maps ------------------------------------------------------------------------


class MapError(Unwrap3DError):
    """A map between two charts does not hold what it promises."""


class FlippedFacesError(MapError):
    """Faces of the spherical map are flipped, so it is not one to one."""


class NotLocatedError(MapError):
    """Points could not be located on a chart."""


class NotCertifiedError(MapError):
    """A chart is not one to one, so it is refused.

    `places` says where: a dict per cluster with ``position_um``, ``position_vu`` and
    ``faces``.
    """

    def __init__(
        self,
        message: str = "",
        *,
        hint: str = "",
        places: tuple[Mapping[str, Any], ...] = (),
        **measured: Any,
    ) -> None:
        super().__init__(message, hint=hint, **measured)
        self.places = places


class ChartMissingError(Unwrap3DError, LookupError):
    """The atlas does not have this chart (yet)."""
