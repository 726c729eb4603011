"""Pictures of the window for the README and docs/, made by using it on a sample cell.

Every step is done through what a person sees: menus' commands, buttons, docks and canvases.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import mouse
import movie_scenes
import numpy as np
from person import LARGE, SMALL, Person, circle
from PIL import Image

PLUGIN = "napari-unwrap3d"
FOLDER = Path(__file__).resolve().parents[1] / "docs" / "pictures"
GAP = 6
RUN_S = 1800.0
# In the uv image of the cell with blebs, as shares of the canvas.
BLEBS, POINT = ((0.726, 0.43), (0.62, 0.43)), (0.66, 0.56)
BOTTOM_UM, FOCUS_UM = 2.0, 4.0
# For the edges of a half-space around the cell.
ROOM = 0.7
# While the tools of shapes are beside it.
SHAPE = ((0.36, 0.44), (0.46, 0.38), (0.60, 0.42), (0.56, 0.56), (0.42, 0.58))
SIGNALS_FROM = 2
# Of the protrusions of the cell with blebs, one that is in the middle of the images.
PROTRUSION = 5


def beside(pictures: list[Image.Image], columns: int) -> Image.Image:
    """Pictures in rows, on one sheet."""
    rows = [pictures[k : k + columns] for k in range(0, len(pictures), columns)]
    width = max(sum(p.width for p in row) + GAP * (len(row) - 1) for row in rows)
    height = sum(max(p.height for p in row) for row in rows) + GAP * (len(rows) - 1)
    sheet = Image.new("RGB", (width, height), (38, 41, 48))
    top = 0
    for row in rows:
        left = 0
        for picture in row:
            sheet.paste(picture, (left, top))
            left += picture.width + GAP
        top += max(p.height for p in row) + GAP
    return sheet


# The day of a person -----------------------------------------------------------------


def open_cell(person: Person, kind: str, project: Path | None) -> None:
    """A sample from the menu, and Run all; or a project that was saved before."""
    if project is not None:
        person.viewer.open(str(project), plugin=PLUGIN)
        person.rest(1.0)
    else:
        person.viewer.open_sample(PLUGIN, kind)
        person.viewer.window.add_plugin_dock_widget(PLUGIN, "Unwrap")
    from napari_unwrap3d.viewer.wizard import Wizard

    person.wizard = person.window.findChildren(Wizard)[0]
    session = person.wizard.session
    if project is None:
        person.rest(1.0)
        person.save("start")
        person.click(person.wizard.run_button)
        person.wait(lambda: session.running, "Run all")
    person.wait(lambda: session.atlas is not None and not session.running, "the run", RUN_S)
    person.wait(lambda: person.canvas.image("topography") is not None, "the topography")
    person.rest(2.0)
    person.settle()


def window(person: Person) -> None:
    """The window after a run."""
    person.save("window")


def light(person: Person) -> None:
    """The same on a large screen, in the light theme."""
    person.viewer.theme = "light"
    person.resize(LARGE)
    person.settle()
    person.save("light")
    person.viewer.theme = "dark"
    person.resize(SMALL)
    person.settle()


def steps(person: Person) -> None:
    """The panels of steps with a plot, opened by a click on the title."""
    panels = [person.wizard.panels[name] for name in ("reference", "sphere", "uv")]
    person.click(person.wizard.panels["stack"].title)
    pictures = []
    for panel in panels:
        person.click(panel.title)
        person.wait(lambda panel=panel: panel.plot.isVisible(), "a plot")
        person.rest(1.0)
        pictures.append(person.picture(panel))
        person.click(panel.title)
    person.save("steps", beside(pictures, 3))


def cursor(person: Person) -> None:
    """The same place in both canvases."""
    person.hover(person.second, (0.65, 0.24))
    assert person.canvas.cursor.place is not None
    person.save("cursor")
    person.leave()


def draw(person: Person) -> None:
    """The dock, an annotation, and a region drawn in uv."""
    _, person.dock = person.viewer.window.add_plugin_dock_widget(PLUGIN, "Annotations")
    person.rest()
    annotating = person.dock.annotating
    while annotating.names:
        person.click(person.dock.list.delete_button)
    for name in list(annotating.annotations.points.positions):
        annotating.annotations.points.remove(name)
    person.dock.list.name_box.setEditText("protrusion")
    person.click(person.dock.list.add_button)
    person.wait(lambda: annotating.layers.layer("protrusion", "uv"), "a layer to draw on")
    person.wait(lambda: person.viewer.layers["surface"].visible, "the surface")
    surface = person.viewer.layers["surface"]
    person.wait(lambda: annotating.painter.ready(surface), "the brush of the surface")
    person.settle()
    for label, place in enumerate(BLEBS, start=1):
        person.dock.label_box.setValue(label)
        person.press("brush")
        person.drag(person.second, circle(*place, 0.05, 0.12))
        person.press("fill")
        person.tap(person.second, place)
    assert set(np.unique(annotating.annotations.labels("protrusion"))) == {0, 1, 2}
    person.press("point")
    person.tap(person.second, POINT)
    assert len(annotating.annotations.points.positions) == 1
    person.click(person.shown.buttons["sphere"])
    look_at(person, "protrusion")
    person.press("brush")
    person.leave()
    person.save("draw")
    person.press("look")


def look_at(person: Person, name: str, chart: str = "surface") -> None:
    """Turn a mesh so that an annotation is in front."""
    annotating = person.dock.annotating
    vertices = getattr(annotating.atlas, chart).vertices
    drawn = np.asarray(annotating.annotations.image(name, chart)) > 0
    outwards = vertices[drawn].mean(axis=0) - vertices.mean(axis=0)
    up = np.cross(np.cross(outwards, (0.0, -1.0, 0.0)), outwards)
    person.viewer.scene.camera.set_view_direction(tuple(-outwards), tuple(up))
    person.click(person.shown.fit_button)


def carried(person: Person) -> None:
    """What was drawn in uv, on the surface, the sphere and the direct chart."""
    pictures = [person.picture(person.second)]
    person.click(person.canvas.chart_buttons["direct"])
    person.wait(lambda: person.canvas.image("direct") is not None, "the direct chart", RUN_S)
    person.settle()
    pictures.append(person.picture(person.second))
    for name in ("surface", "sphere"):
        _show_alone(person, name)
        look_at(person, "protrusion", name)
        pictures.append(person.picture(person.main))
    person.save("carried", beside(pictures, 2))
    _show_alone(person, "surface")
    look_at(person, "protrusion")
    person.click(person.canvas.chart_buttons["uv"])


def _show_alone(person: Person, name: str) -> None:
    from qtpy.QtCore import Qt
    from qtpy.QtTest import QTest

    button = person.shown.buttons[name]
    assert button.isEnabled()
    QTest.mouseDClick(button, Qt.MouseButton.LeftButton)
    person.settle()


def paint(person: Person) -> None:
    """The brush on the surface."""
    person.dock.label_box.setValue(3)
    person.press("brush")
    before = np.array(person.dock.annotating.annotations.labels("protrusion"))
    person.drag(person.main, [(0.42, 0.45), (0.5, 0.6), (0.58, 0.45)])
    after = np.array(person.dock.annotating.annotations.labels("protrusion"))
    assert (after != before).any(), "nothing was painted on the surface"
    person.settle()
    person.save("paint")
    person.press("look")


def topography(person: Person) -> None:
    """A slice of the field in (d, v, u), and the signal's maximum over depths."""
    person.click(person.canvas.chart_buttons["topography"])
    bar = person.canvas.depth_bar
    person.wait(lambda: not bar.busy, "the field in the topography", RUN_S)
    person.settle()
    pictures = [person.picture(person.canvas)]
    if bar.content.count() > SIGNALS_FROM:
        bar.show_content(bar.content.itemText(SIGNALS_FROM))
        person.wait(lambda: not bar.busy, "the signal of the topography", RUN_S)
    person.settle()
    bar.set_range("Maximum", 0.0, float(bar.d_um[-1]))
    person.settle()
    pictures.append(person.picture(person.canvas))
    person.save("topography", beside(pictures, 1))
    bar.show_content(bar.content.itemText(0))
    bar.set_depth(0.0)
    person.click(person.canvas.chart_buttons["uv"])


def region(person: Person) -> None:
    """A half-space for what is out of focus, with its edges in 3D."""
    _annotate(person, "out of focus")
    _from_the_side(person)
    person.viewer.scene.camera.zoom *= ROOM
    regions = person.dock.regions
    high = float(person.dock.annotating.atlas.surface.vertices[:, 0].max())
    regions.position.setValue(high - FOCUS_UM)
    person.click(regions.add_button)
    assert person.dock.annotating.annotations.labels("out of focus").any()
    regions.position.setValue(high - FOCUS_UM - 0.5)
    assert len(regions.preview.segments), "no edges are seen"
    person.bring_into_view(regions.remove_button)
    person.save("region")


def shapes(person: Person) -> None:
    """A polygon in uv, and its corners."""
    from qtpy.QtTest import QTest

    _annotate(person, "marked")
    person.click(person.dock.regions.shapes_button)
    for place in SHAPE:
        person.tap(person.second, place)
    end = mouse.point_at(person.second, SHAPE[-1])
    QTest.mouseDClick(person.second, mouse.LEFT, pos=end)
    person.rest()
    assert person.dock.annotating.annotations.labels("marked").any(), "the polygon marks nothing"
    layer = person.dock.annotating.shapes.layer("marked", "uv")
    layer.mode, layer.selected_data = "direct", {0}
    look_at(person, "marked")
    person.leave()
    person.save("shapes")
    person.click(person.canvas.tools_button)
    layer.mode = "pan_zoom"


def _annotate(person: Person, name: str) -> None:
    """Add an annotation, to be drawn with label 1."""
    person.dock.list.name_box.setEditText(name)
    person.click(person.dock.list.add_button)
    person.dock.label_box.setValue(1)
    person.rest()


def _from_the_side(person: Person) -> None:
    """The surface with z down, as in the stack."""
    _show_alone(person, "surface")
    person.viewer.scene.camera.set_view_direction((0.25, 0.9, 0.35), (-1.0, 0.25, 0.0))
    person.click(person.shown.fit_button)


def bottom(person: Person) -> None:
    """A half-space and the plane that fits a label."""
    _annotate(person, "cell bottom")
    low = float(person.dock.annotating.atlas.surface.vertices[:, 0].min())
    person.dock.regions.side_box.setCurrentText("up to here")
    person.dock.regions.position.setValue(low + BOTTOM_UM)
    person.click(person.dock.regions.add_button)
    assert person.dock.annotating.annotations.labels("cell bottom").any()
    person.click(person.dock.measures.plane_button)
    person.wait(lambda: "normal" in person.dock.measures.result.text(), "the plane")
    person.rest(1.5)
    _from_the_side(person)
    person.bring_into_view(person.dock.measures.result)
    person.save("plane")


def protrusions(person: Person) -> None:
    """The table, and one protrusion that is selected in every view."""
    from napari_unwrap3d.viewer.annotations.annotating import annotating_of
    from napari_unwrap3d.viewer.common.docking import dock_of
    from napari_unwrap3d.viewer.protrusions.table import ProtrusionTable

    annotating, session = annotating_of(person.viewer), person.wizard.session
    for name in annotating.names:
        annotating.set_visible(name, name == "protrusions")
    dock_of(person.wizard).raise_()
    person.rest()
    person.click(person.wizard.panels["protrusions"].run_button)
    person.wait(lambda: not session.running and session.atlas.has("protrusions"), "them", RUN_S)
    person.wizard.hint.linkActivated.emit("Protrusions table")
    person.settle()
    (table,) = person.window.findChildren(ProtrusionTable)
    person.wait(lambda: not table.instances.busy, "the table")
    _show_alone(person, "surface")
    table.instances.select([PROTRUSION])
    person.click(table.edit_bar.buttons["show"])
    person.wait(lambda: not table.square.busy, "the square image")
    person.click(person.shown.fit_button)
    person.leave()
    person.save("protrusions")


SCENES = (
    window,
    light,
    steps,
    cursor,
    draw,
    carried,
    paint,
    topography,
    region,
    shapes,
    bottom,
    protrusions,
)


@contextmanager
def own_settings() -> Iterator[None]:
    """Neither the settings nor the unsaved cells of whoever calls this."""
    with tempfile.TemporaryDirectory() as folder:
        # napari reads this when it is imported.
        os.environ["NAPARI_CONFIG"] = str(Path(folder) / "settings.yaml")
        from napari_unwrap3d.viewer.files import autosave

        # An absolute folder wins over where the system keeps such files.
        autosave.FOLDER = str(Path(folder) / "unsaved")
        yield


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kind", default="blebs", help="of simulated cell")
    parser.add_argument("--project", type=Path, help="show a saved cell instead of a run")
    parser.add_argument("-o", "--output", type=Path, default=FOLDER)
    parser.add_argument("--keep", type=Path, help="save the unwrapped cell there")
    parser.add_argument("--parts", nargs="+", choices=("cell", "movie"), default=("cell", "movie"))
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    with own_settings():
        person = Person(options.output)
        if "cell" in options.parts:
            open_cell(person, options.kind, options.project)
            if options.keep is not None:
                person.wizard.save(options.keep)
                person.wait(lambda: person.wizard.session.project_path, "saving", RUN_S)
            for scene in SCENES:
                scene(person)
        if "movie" in options.parts:
            person.viewer.layers.clear()
            for scene in movie_scenes.SCENES:
                scene(person)
        person.viewer.close()


if __name__ == "__main__":
    main()
