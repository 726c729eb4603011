"""A window for benchmarks: on this display, or on a virtual one."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

SCREEN = "-screen 0 1600x1200x24"


def on_a_display() -> None:
    """Start the script anew on a virtual display where there is none."""
    if os.environ.get("DISPLAY") or sys.platform != "linux":
        return
    virtual = shutil.which("xvfb-run")
    if virtual is None:
        sys.exit("This benchmark needs a display, or xvfb-run.")
    command = [virtual, "-a", "-s", SCREEN, sys.executable, *sys.argv]
    sys.exit(subprocess.run(command, env=os.environ | {"QT_QPA_PLATFORM": "xcb"}).returncode)


def wait_until(condition: Callable[[], Any], limit_s: float) -> None:
    """Let the window live until something is true."""
    from qtpy.QtWidgets import QApplication

    stop = time.monotonic() + limit_s
    while not condition():
        if time.monotonic() > stop:
            raise TimeoutError(f"not within {limit_s:.0f} s")
        QApplication.processEvents()
        time.sleep(0.002)


def mouse() -> ModuleType:
    """The mouse of the pictures and the tests; Qt is imported only now."""
    folder = str(Path(__file__).resolve().parents[2] / "tools")
    if folder not in sys.path:
        sys.path.append(folder)
    import mouse as found

    return found
