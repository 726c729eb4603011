"""Connections to a viewer's events that end with the widget that made them."""

from __future__ import annotations

from typing import Any


def disconnect(connections: list[tuple[Any, Any]], *_: Any) -> None:
    """Undo connections (emitter, callback), and forget them."""
    for emitter, callback in connections:
        emitter.disconnect(callback)
    connections.clear()
