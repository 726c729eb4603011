"""How soon the shape follows a slider: the flow's iteration, and conformal to equiareal.

    .venv/bin/python benchmarks/views_sliders.py

A simulated cell is unwrapped in a window with a reference of 30 000 vertices. Then the two
sliders of the panels are moved through their values; the CPU time of the process from the
slider's change to the new vertices in the layer is measured, and apart from it what drawing
them takes, by software where there is no graphics card.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from common import results
from common.children import options_of, run_child
from common.results import Bar, Entries
from common.window import on_a_display, wait_until

import napari_unwrap3d as unwrap3d

LIMIT_S = 1200.0
VERTICES = 30_000
SIZE = 150
EVENTS = 20
BAR = Bar(150.0, "CPU ms per event")


def run_all() -> dict[str, Any]:
    """Milliseconds of every event of the two sliders."""
    import napari
    from qtpy.QtWidgets import QApplication

    from napari_unwrap3d.viewer import demo
    from napari_unwrap3d.viewer.steps import previews

    groups = {"uv": {"rows": 128}, "reference": {"vertices": VERTICES}}
    viewer = napari.Viewer()
    wizard = demo.start_demo(
        viewer, "blebs", parameters=unwrap3d.Parameters.from_dict(groups), size=SIZE
    )
    session = wizard.session
    session.update_automatically = False
    wait_until(lambda: not session.running, LIMIT_S)
    wait_until(lambda: session.previews.flow is not None, LIMIT_S)

    def events(step: str, name: str, values: Any, shown: Callable[[], Any]) -> dict[str, Any]:
        slider = wizard.panels[step].form.entries[f"{step}.{name}"].widget
        wizard.panels[step].expand(True)
        # The first event makes what the others use.
        slider.value = type(slider.value)(values[-1])
        wait_until(lambda: True, 1.0)
        own, drawn = [], []
        for value in values:
            before = shown()
            start = time.process_time()
            slider.value = type(slider.value)(value)
            own.append(1000 * (time.process_time() - start))
            if shown() is before:
                raise RuntimeError(f"{name} = {value} changed nothing")
            start = time.process_time()
            QApplication.processEvents()
            drawn.append(1000 * (time.process_time() - start))
        return {"own": own, "drawn": drawn, "vertices": len(shown())}

    iterations = np.tile(np.arange(1, EVENTS // 2 + 1), 2)
    found = {
        "views/slider-iteration": events(
            "reference",
            "fixed_iteration",
            iterations,
            lambda: _vertices(viewer, previews.NAME),
        ),
        "views/slider-blend": events(
            "sphere",
            "blend",
            np.linspace(0.0, 0.95, EVENTS),
            lambda: _vertices(viewer, "sphere"),
        ),
    }
    viewer.close()
    return found


def _vertices(viewer: Any, name: str) -> Any:
    return viewer.layers[name].vertices if name in viewer.layers else None


def entries_of(found: Any) -> Entries:
    """The median event against the bar; the slowest and the drawing beside it."""
    names = ("views/slider-iteration", "views/slider-blend")
    if isinstance(found, str):
        return {name: BAR.entry(None, note=found) for name in names}
    return {
        name: BAR.entry(
            float(np.median(item["own"])),
            slowest=results.significant(max(item["own"]), 3),
            drawing=results.significant(float(np.median(item["drawn"])), 3),
            vertices=item["vertices"],
            events=len(item["own"]),
        )
        for name, item in found.items()
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options_of(parser, run_all)
    on_a_display()
    entries = entries_of(run_child(__file__, limit_s=LIMIT_S))
    results.show(entries)
    results.merge(entries)


if __name__ == "__main__":
    main()
