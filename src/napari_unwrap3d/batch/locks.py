"""Files that one process holds at a time; the system lets go of them when it ends, however."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import IO


def held(path: Path) -> IO[bytes] | None:
    """Hold a lock file until what is returned is closed; None while another process does."""
    path.parent.mkdir(parents=True, exist_ok=True)
    file = path.open("ab")
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):
        file.close()
        return None
    except OSError:
        # A file system without locks: there is nothing to hold, and no one to keep out.
        return file
    return file


def user_cache() -> Path:
    """The folder for caches of this package."""
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "napari-unwrap3d"
