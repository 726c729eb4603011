"""Write to a temporary sibling and rename, so that nothing half-written stays."""

from __future__ import annotations

import errno
import json
import math
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

# What file systems answer that cannot flush a file.
CANNOT_FLUSH = (errno.EINVAL, errno.ENOTSUP, errno.ENOSYS)


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Give a temporary path beside `path`; it takes the place of `path` at the end.

    When the block raises, also through Ctrl-C or because the disk is full, what was written
    is removed and what stood at `path` before is left as it was. What is written beside the
    temporary path moves along, before it: the texture of a mesh, say. A folder is
    replaced like a file.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    folder = Path(tempfile.mkdtemp(prefix=f".{path.name}.", suffix=".partial", dir=path.parent))
    try:
        # The temporary file keeps its name: some writers choose the format by suffix.
        partial = folder / path.name
        yield partial
        beside = sorted(entry for entry in folder.iterdir() if entry != partial)
        for entry in (*beside, partial):
            _flush(entry)
        for entry in (*beside, partial):
            _put(entry, path.parent / entry.name)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _flush(path: Path) -> None:
    """Have a file, or every file of a folder, on the disk: only then is it known to fit."""
    for entry in path.rglob("*") if path.is_dir() else (path,):
        if entry.is_file():
            with entry.open("rb+") as file:
                try:
                    os.fsync(file.fileno())
                except OSError as error:
                    if error.errno not in CANNOT_FLUSH:
                        raise


def _put(entry: Path, target: Path) -> None:
    """Move a file or folder to `target`, in place of what is there."""
    if not entry.is_dir() or not target.is_dir() or target.is_symlink():
        os.replace(entry, target)
        return
    before = entry.with_name(f"{entry.name}.before")  # no folder can be replaced in one step
    os.replace(target, before)
    try:
        os.replace(entry, target)
    except OSError:
        os.replace(before, target)
        raise


def write_text(path: str | Path, text: str) -> Path:
    """Write UTF-8 text atomically."""
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8")
    return Path(path)


def write_json(path: str | Path, value: Any) -> Path:
    """Write JSON atomically; NaN and infinities become null, as JSON has none."""
    text = json.dumps(plain(value, lambda number: None), indent=2, allow_nan=False)
    return write_text(path, text + "\n")


def _named(number: float) -> str:
    if math.isnan(number):
        return "NaN"
    return "Infinity" if number > 0 else "-Infinity"


def plain(value: Any, not_finite: Any = _named) -> Any:
    """What JSON can hold: mappings, lists, text, numbers, booleans, None.

    numpy scalars and arrays become numbers and lists; tuples become lists.

    Parameters
    ----------
    value : object
    not_finite : callable
        Turns NaN and infinities into something JSON has; by default their names,
        from which :func:`from_plain` restores them.
    """
    if isinstance(value, Mapping):
        return {str(key): plain(item, not_finite) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist(), not_finite)
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item, not_finite) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else not_finite(value)
    if value is None or isinstance(value, str | bool | int):
        return value
    return str(value)


def from_plain(value: Any) -> Any:
    """Undo the names that :func:`plain` gives to NaN and infinities."""
    if isinstance(value, dict):
        return {key: from_plain(item) for key, item in value.items()}
    if isinstance(value, list):
        return [from_plain(item) for item in value]
    if isinstance(value, str) and value in ("NaN", "Infinity", "-Infinity"):
        return float(value)
    return value
