"""A look at the Qt binding, which can be unsound in a way that no plugin can mend."""

from __future__ import annotations

import functools
import sys

import qtpy
from napari.utils.notifications import show_warning
from qtpy.QtCore import QObject

CALLS = 100


def drops_references() -> bool:
    """Whether the binding returns None without counting it.

    PySide6 6.12.0 takes None and True for immortal, which they are from Python 3.12 on.
    Before, each call takes one reference from them, and Python aborts when none is left:
    after minutes of use, wherever the program happens to be, without a word.
    """
    probe = QObject()
    before = sys.getrefcount(None)
    for _ in range(CALLS):
        probe.parent()
    return sys.getrefcount(None) < before - CALLS // 2


@functools.cache
def warn_of_binding() -> None:
    """Tell the user, once, if this Qt binding will end the program."""
    if drops_references():
        version = qtpy.PYSIDE_VERSION or qtpy.PYQT_VERSION
        python = f"{sys.version_info.major}.{sys.version_info.minor}"
        show_warning(
            f"{qtpy.API_NAME} {version} makes Python {python} crash after a while, and what is "
            "not saved is lost. Use Python 3.12 or later, or: pip install 'PySide6<6.12'"
        )
