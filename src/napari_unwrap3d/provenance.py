"""What an atlas was made from and with: versions, input, keys, timings, repairs."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

PACKAGES = ("numpy", "scipy", "numba", "scikit-image", "libigl")


def package_version(name: str = "napari-unwrap3d") -> str:
    """Version of an installed package, "unknown" when it is not installed."""
    try:
        return version(name)
    except PackageNotFoundError:
        return "unknown"


def environment() -> dict[str, str]:
    """Versions of this package, of Python and of the libraries that results depend on."""
    return {
        "napari-unwrap3d": package_version(),
        "python": platform.python_version(),
        "platform": platform.platform(),
        **{name: package_version(name) for name in PACKAGES},
    }


def content_hash(*parts: Any) -> str:
    """Hash of arrays, strings, numbers and None, equal for equal contents."""
    digest = hashlib.blake2b(digest_size=16)
    for part in parts:
        if isinstance(part, np.ndarray):
            digest.update(f"{part.dtype}{part.shape}".encode())
            digest.update(np.ascontiguousarray(part).view(np.uint8).data)
        else:
            digest.update(repr(part).encode())
        digest.update(b"\0")
    return digest.hexdigest()


def repairs(reports: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Every automatic repair as a sentence, from the numbers of the first steps."""
    found = []
    for step, numbers in reports.items():
        done = numbers.get("repairs", ())
        found += [f"{step}: {item['what']} ({item['count']})" for item in done]
        for name, value in numbers.items():
            if name == "repairs":
                continue
            is_repair = any(
                word in name for word in ("repair", "dropped", "sealed", "lost", "filled")
            )
            if is_repair and value:
                found.append(f"{step}: {name.replace('_', ' ')} = {value}")
    return found
