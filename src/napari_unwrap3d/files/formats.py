"""In which formats an export writes meshes, images and tables."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ..errors import ParameterError
from .tables import check_parquet

MESHES = {"ply": ".ply", "obj": ".obj", "stl": ".stl", "vtp": ".vtp", "off": ".off"}
IMAGES = {"ome-tiff": ".ome.tif", "ome-zarr": ".ome.zarr"}
TABLES = {"csv": ".csv", "parquet": ".parquet"}
NAMES = (*MESHES, *IMAGES, *TABLES)


@dataclass(frozen=True)
class Formats:
    """The suffixes that are written, of each kind one or more."""

    meshes: tuple[str, ...] = (".ply",)
    images: tuple[str, ...] = (".ome.tif",)
    tables: tuple[str, ...] = (".csv",)

    @classmethod
    def named(cls, names: Iterable[str]) -> Formats:
        """The formats of these names; a kind of which none is named keeps its default.

        Raises
        ------
        ParameterError
            There is no such format.
        InputError
            Parquet is wanted, and pyarrow is not installed.
        """
        wanted = list(dict.fromkeys(names))
        for name in wanted:
            if name not in NAMES:
                raise ParameterError(
                    f"There is no format {name!r}.", hint=f"Formats: {', '.join(NAMES)}."
                )
        if "parquet" in wanted:
            check_parquet()
        kinds = {"meshes": MESHES, "images": IMAGES, "tables": TABLES}
        chosen = {
            kind: tuple(known[name] for name in wanted if name in known)
            for kind, known in kinds.items()
        }
        return cls(**{kind: suffixes for kind, suffixes in chosen.items() if suffixes})
