"""The Qt binding itself."""

from __future__ import annotations

from typing import Any

import pytest

from napari_unwrap3d.viewer.common import binding
from napari_unwrap3d.viewer.session import session_of


def test_this_binding_counts_what_it_returns() -> None:
    """Where this fails other tests abort, anywhere: take another version of the binding."""
    assert not binding.drops_references()


def test_an_unsound_binding_is_told_once(
    make_napari_viewer: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []
    monkeypatch.setattr(binding, "drops_references", lambda: True)
    monkeypatch.setattr(binding, "show_warning", told.append)
    binding.warn_of_binding.cache_clear()
    try:
        for _ in range(2):
            session_of(make_napari_viewer())
    finally:
        binding.warn_of_binding.cache_clear()
    assert len(told) == 1
    assert "crash" in told[0]
    assert "PySide6<6.12" in told[0]
