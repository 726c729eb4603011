"""Pictures of a movie and of its tracks, made by using the window as a person does."""

from __future__ import annotations

from typing import Any

import mouse
from person import Person
from qtpy.QtTest import QTest

PLUGIN = "napari-unwrap3d"
SAMPLE = "blebbing"
SECONDS = 1800.0
# A line across the uv image, as shares of the canvas.
LINE = ((0.15, 0.45), (0.5, 0.35), (0.85, 0.5))
# The longest tracks are selected, and the timepoint is in the middle of the first.
SELECTED = 3


def movie(person: Person) -> None:
    """A timelapse from the sample menu, unwrapped, with a kymograph along a line."""
    person.viewer.open_sample(PLUGIN, SAMPLE)
    _, person.wizard = person.viewer.window.add_plugin_dock_widget(PLUGIN, "Unwrap")
    panel = person.wizard.show_movie()
    person.rest(1.0)
    person.click(panel.run_button)
    person.wait(lambda: panel.run.running, "Run all")
    done = person.wizard.session
    person.wait(
        lambda: not panel.run.running and not done.running and panel.movies.frame is not None,
        "the movie",
        SECONDS,
    )
    person.settle()
    _, dock = person.viewer.window.add_plugin_dock_widget(PLUGIN, "Kymograph")
    person.rest()
    person.click(dock.draw_button)
    for place in LINE:
        person.tap(person.second, place)
    QTest.mouseDClick(person.second, mouse.LEFT, pos=mouse.point_at(person.second, LINE[-1]))
    person.wait(lambda: dock.found is not None and not dock.busy, "the kymograph")
    person.click(person.canvas.tools_button)
    _go_to(person, panel, len(panel.movies.movie) // 2)
    person.click(person.shown.fit_button)
    person.leave()
    person.save("movie")
    person.viewer.window.remove_dock_widget(dock)
    person.rest()


def tracks(person: Person) -> None:
    """Blebs are tracked; some tracks are selected, and their series are drawn."""
    panel = person.wizard.show_tracks()
    person.rest()
    section = panel.sections["protrusions"]
    person.click(section.run_button)
    session = panel.tracks
    person.wait(lambda: session.tracks is not None and not panel.run.busy_with, "tracks", SECONDS)
    person.click(panel.plots_button)
    _, plots = person.viewer.window.add_plugin_dock_widget(PLUGIN, "Track plots")
    person.click(plots.measure_button)
    person.wait(lambda: session.measurements is not None, "measurements", SECONDS)
    table = session.shown.track_table.sort_values("lifetime_s", ascending=False)
    longest = table.head(SELECTED)
    session.select(longest.track_id.tolist())
    first, last = longest.first_timepoint.iloc[0], longest.last_timepoint.iloc[0]
    _go_to(person, person.wizard.show_movie(), int(first + last) // 2)
    panel.open_dock("Track plots")
    person.click(person.shown.fit_button)
    person.save("tracks")


def _go_to(person: Person, panel: Any, timepoint: int) -> None:
    """Show a timepoint."""
    panel.movies.set_timepoint(timepoint)
    person.wait(lambda: panel.movies.timepoint == timepoint, "the timepoint")
    person.rest(1.0)


SCENES = (movie, tracks)
