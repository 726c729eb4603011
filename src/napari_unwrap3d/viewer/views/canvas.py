"""The second canvas of a viewer: the unwrapped charts, in pixels, beside the 3D view.

It is a viewer of its own in a dock of the window. Each chart has its own zoom and its own
layers; those of the other charts are hidden, also in the list.
"""

from __future__ import annotations

import weakref
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from napari.components import ViewerModel
from napari.qt import QtViewer
from napari.utils.action_manager import action_manager
from qtpy.QtCore import QEvent, QObject, Qt, Signal
from qtpy.QtWidgets import (
    QButtonGroup,
    QDockWidget,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QSplitter,
    QStackedWidget,
    QVBoxLayout,
    QWidget,
)

from ..common.notice import Notice, small_button
from ..common.turns import soon
from .gl_context import finish_in_own_context
from .layers import UNWRAPPED, LayerData
from .placing import chart_of, placing
from .requested import MEANINGS, RequestedCharts

if TYPE_CHECKING:
    from napari.layers import Layer

    from ...atlas import Atlas
    from ..session import Session

DOCK_NAME = "Unwrapped"
TITLES = {"uv": "uv", "direct": "Direct", "plane": "Plane", "topography": "Topography"}
SHARE_OF_HEIGHT = 0.5
MARGIN = 0.02
MINIMUM_WIDTH = 420

HELP = """<b>This canvas</b> (the unwrapped cell; v goes down, u to the right)<br>
left drag: move &nbsp; wheel or right drag: zoom<br>
Ctrl+R (⌘R): whole image &nbsp; V: hide or show the selected layer<br>
← →: depth, in the topography<br>
pointer: the same place is marked in 3D, and its numbers stand below<br><br>
<b>3D canvas</b> (the cell, in µm)<br>
left drag: turn &nbsp; Shift + left drag: move &nbsp; wheel or right drag: zoom<br>
Ctrl+Y (⌘Y): slices or 3D &nbsp; Ctrl+R (⌘R): everything<br>
pointer over the surface: the same place is marked here"""


@dataclass
class _ChartView:
    """What a chart looked like when it was shown last."""

    center: Any = None
    zoom: float = 1.0
    # The whole image, until the user moves or zooms it.
    fitted: bool = True
    active: Any = None


@dataclass(eq=False)
class _ChartLayer:
    """The chart a layer belongs to, and whether it is visible when that is shown."""

    chart: str
    visible: bool


@dataclass
class _Shown:
    """What is shown, and how."""

    chart: str = "uv"
    views: dict[str, _ChartView] = field(
        default_factory=lambda: {chart: _ChartView() for chart in UNWRAPPED}
    )


class UnwrappedCanvas(QWidget):
    """The canvas of the unwrapped charts. Get it with :func:`canvas_of`.

    Attributes
    ----------
    model : napari.components.ViewerModel
        Its layers and camera. World coordinates are indices: (v, u), or (d, v, u) with d
        counted in layers.
    qt_viewer : napari.qt.QtViewer
    colouring : Colouring
        The field that colours every view.
    cursor : LinkedCursor
        The place under the pointer, in every view.

    Signals
    -------
    chart_changed(str)
        Another chart is shown.
    charts_changed()
        A chart was computed on request.
    """

    chart_changed = Signal(str)
    charts_changed = Signal()

    def __init__(self, viewer: Any, session: Session, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.session = session
        self.model = ViewerModel(title=DOCK_NAME)
        # The keys stay what they were. napari binds them anew for every viewer, and tells all
        # of its welcome screens of each one, which takes longer than making the viewer.
        with action_manager.events.shortcut_changed.blocker():
            self.qt_viewer = QtViewer(self.model)
        for each in (viewer.window._qt_viewer, self.qt_viewer):
            finish_in_own_context(each)
        # napari makes these when they are first read, which must be before there are layers.
        self.controls, self.layer_list = self.qt_viewer.controls, self.qt_viewer.layers
        self._shown = _Shown()
        self._viewer = weakref.ref(viewer)
        self._layers: weakref.WeakKeyDictionary[Layer, _ChartLayer] = weakref.WeakKeyDictionary()
        self.requested = RequestedCharts(session, self)
        self._closed = False
        self._build(viewer)
        self._connect(viewer)
        self._update()

    # Building ------------------------------------------------------------------

    def _build(self, viewer: Any) -> None:
        from .colouring import Colouring, ColouringBar
        from .depth import DepthBar
        from .lighting import Lighting
        from .linking import LinkedCursor

        self.qt_viewer.canvas.native.setMinimumSize(160, 80)
        self.qt_viewer.dims.hide()
        self.colouring = Colouring(viewer, self)
        self.colour_bar = ColouringBar(self.colouring)
        self.depth_bar = DepthBar(self)
        self.notice = Notice()
        self.status = QLabel()
        self.status.setObjectName("unwrappedStatus")
        self.status.setMinimumWidth(1)
        self.setMinimumWidth(MINIMUM_WIDTH)
        self.status.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.pages = QStackedWidget()
        self.pages.addWidget(self.qt_viewer)
        self.pages.addWidget(self.notice)
        self.tools = self._tools()
        splitter = QSplitter(Qt.Orientation.Horizontal)
        splitter.addWidget(self.tools)
        splitter.addWidget(self.pages)
        splitter.setStretchFactor(1, 1)
        column = QVBoxLayout(self)
        column.setContentsMargins(4, 2, 4, 2)
        column.setSpacing(2)
        column.addLayout(self._header())
        column.addWidget(self.colour_bar)
        column.addWidget(self.depth_bar)
        column.addWidget(splitter, 1)
        column.addWidget(self.status)
        self.cursor = LinkedCursor(viewer, self)
        self._lighting = Lighting(viewer, self)

    def _header(self) -> QHBoxLayout:
        row = QHBoxLayout()
        row.setSpacing(2)
        self.chart_buttons: dict[str, QPushButton] = {}
        group = QButtonGroup(self)
        for chart in UNWRAPPED:
            button = small_button(TITLES[chart], MEANINGS[chart], checkable=True)
            group.addButton(button)
            button.clicked.connect(lambda _=False, chart=chart: self.show_chart(chart))
            row.addWidget(button)
            self.chart_buttons[chart] = button
        row.addStretch(1)
        self.tools_button = small_button(
            "Layers", "The layers of this chart, and how they are drawn.", checkable=True
        )
        self.tools_button.toggled.connect(self.tools.setVisible)
        self.fit_button = small_button("Fit", "Show the whole image.")
        self.fit_button.clicked.connect(self.fit)
        self.help_button = small_button("?", HELP)
        self.help_button.clicked.connect(self.show_help)
        for button in (self.tools_button, self.fit_button, self.help_button):
            row.addWidget(button)
        return row

    def _tools(self) -> QWidget:
        tools = QSplitter(Qt.Orientation.Vertical)
        tools.addWidget(self.controls)
        tools.addWidget(self.layer_list)
        tools.setVisible(False)
        return tools

    def _connect(self, viewer: Any) -> None:
        self.session.finished.connect(self._on_atlas)
        self.session.steps_changed.connect(self._update)
        viewer.events.theme.connect(self._on_theme)
        self._on_theme()
        layers = self.model.layers.events
        layers.inserted.connect(self._on_inserted)
        for event in (layers.inserted, layers.removed, layers.reordered):
            event.connect(self._list_later)
        self.model.canvas.events.size.connect(self._on_resized)
        self.model.dims.events.ndisplay.connect(self._on_ndisplay)
        self.notice.pressed.connect(self._on_notice)
        self.requested.changed.connect(self._update)
        self.requested.computed.connect(self._on_computed)
        self.model.mouse_wheel_callbacks.append(self._on_wheel)
        self.model.mouse_drag_callbacks.append(self._on_drag)
        self._list_timer = soon(self, self._update_list)
        self._fit_timer = soon(self, self._fit_again)

    def _on_theme(self, _: Any = None) -> None:
        viewer = self._viewer()
        if viewer is not None:
            self.model.theme = viewer.theme

    # The chart ------------------------------------------------------------------

    @property
    def chart(self) -> str:
        """The chart that is shown: "uv", "direct", "plane" or "topography"."""
        return self._shown.chart

    @property
    def atlas(self) -> Atlas | None:
        return self.session.atlas

    def show_chart(self, chart: str) -> None:
        """Show another chart, as it was left; one that is not there offers to be computed."""
        if chart not in UNWRAPPED:
            raise ValueError(f"There is no chart {chart!r} here: {UNWRAPPED}")
        if chart != self.chart:
            self._leave()
            self._shown.chart = chart
            self._enter()
        self._update()

    def _leave(self) -> None:
        view = self._view
        view.active = self.model.layers.selection.active
        view.center, view.zoom = self.model.scene.camera.center, self.model.scene.camera.zoom
        for layer in self._of_chart():
            self._layers[layer].visible = layer.visible

    def _enter(self) -> None:
        for layer, known in list(self._layers.items()):
            layer.visible = known.chart == self.chart and known.visible
        here = self._of_chart()
        view = self._view
        active = view.active if view.active in here else (here[0] if here else None)
        self.model.layers.selection.active = active
        if view.fitted:
            self.fit()
        else:
            self.model.scene.camera.center, self.model.scene.camera.zoom = view.center, view.zoom
        self._list_later()
        self.chart_changed.emit(self.chart)

    @property
    def _view(self) -> _ChartView:
        return self._shown.views[self.chart]

    def _of_chart(self) -> list[Layer]:
        """The layers of the chart that is shown, the lowest first."""
        return [
            layer
            for layer in self.model.layers
            if layer in self._layers and self._layers[layer].chart == self.chart
        ]

    # Layers ---------------------------------------------------------------------

    def add_chart_layer(self, layer: Layer, chart: str) -> Layer:
        """Add a layer that is visible only while its chart is shown.

        Parameters
        ----------
        layer : napari Layer
            In pixels: (v, u), or (d layer, v, u) for the topography.
        chart : str
            One of the charts of this canvas.
        """
        self._layers[layer] = _ChartLayer(chart, layer.visible)
        self.model.add_layer(layer)
        return layer

    def image(self, chart: str) -> Layer | None:
        """The image of a chart itself, None before it is there."""
        return next((layer for layer in self.model.layers if chart_of(layer) == chart), None)

    def place(self, layers: Iterable[LayerData]) -> Iterator[None]:
        """Show the images of charts in place of the old ones, one per step."""
        yield from placing(self.model, list(layers))
        self._update()
        # An image may have another size now.
        self._fit_timer.start()

    def show_tools(self, shown: bool = True) -> None:
        """Show the list and the controls of the layers beside the image."""
        self.tools_button.setChecked(shown)

    def _on_inserted(self, event: Any) -> None:
        layer = event.value
        chart = chart_of(layer)
        if layer not in self._layers and chart in UNWRAPPED:
            self._layers[layer] = _ChartLayer(chart, layer.visible)
        if layer in self._layers and self._layers[layer].chart != self.chart:
            layer.visible = False
        elif self._view.fitted:
            self.fit()

    def _list_later(self, _: Any = None) -> None:
        self._list_timer.start()

    def _update_list(self) -> None:
        """Hide the rows of the other charts' layers; the list is upside down."""
        here, active = self._of_chart(), self.model.layers.selection.active
        if here and (active is None or (active in self._layers and active not in here)):
            self.model.layers.selection.active = here[0]
        for row, layer in enumerate(reversed(self.model.layers)):
            known = self._layers.get(layer)
            hidden = known is not None and known.chart != self.chart
            self.layer_list.setRowHidden(row, hidden)

    # The view -------------------------------------------------------------------

    def fit(self) -> None:
        """Show the whole image, and keep doing so while the window changes its size."""
        image = self.image(self.chart)
        if image is not None:
            # napari's own fit needs layers with as many axes as the viewer.
            size = np.asarray(image.data.shape[-2:])
            camera = self.model.scene.camera
            camera.center = (0.0, *((size - 1) / 2))
            camera.zoom = (1 - MARGIN) * float((np.asarray(self.model.canvas.size) / size).min())
        self._view.fitted = True

    def _fit_again(self) -> None:
        if self._view.fitted:
            self.fit()

    def _on_ndisplay(self, _: Any = None) -> None:
        """The shortcut for 3D is for the other canvas."""
        self.model.dims.ndisplay = 2

    def _on_resized(self, _: Any = None) -> None:
        # Later, because napari still adapts its own zoom to the size.
        self._fit_timer.start()

    def _on_wheel(self, *_: Any) -> None:
        self._view.fitted = False

    def _on_drag(self, _: Any, event: Any) -> Iterator[None]:
        """A drag may move the image, or paint in it."""
        center = self.model.scene.camera.center
        yield
        while event.type == "mouse_move":
            yield
        if self.model.scene.camera.center != center:
            self._view.fitted = False

    def show_help(self) -> None:
        """Say which buttons and keys do what."""
        from qtpy.QtWidgets import QToolTip

        below = self.help_button.mapToGlobal(self.help_button.rect().bottomLeft())
        QToolTip.showText(below, HELP, self.help_button)

    # Charts on request ----------------------------------------------------------

    def compute(self, chart: str) -> None:
        """Compute direct or plane in a thread; it is shown when it is done."""
        self.requested.compute(chart)

    def _on_computed(self, _: str) -> None:
        self.charts_changed.emit()

    def _on_notice(self, chart: str) -> None:
        if chart in self.requested.refused:
            self.show_chart("direct")
        else:
            self.compute(chart)

    def _on_atlas(self, _: Any) -> None:
        self.charts_changed.emit()
        self._update()

    def _update(self) -> None:
        """Show the chart, or why it is not there."""
        if self._closed:
            return
        self.chart_buttons[self.chart].setChecked(True)
        self.depth_bar.setVisible(self.chart == "topography")
        there = self.image(self.chart) is not None
        self.pages.setCurrentIndex(0 if there else 1)
        self.fit_button.setEnabled(there)
        if not there:
            self.requested.explain(self.chart, self.notice)

    # The end ----------------------------------------------------------------------

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """The window closes: napari must find no viewer left."""
        if event.type() == QEvent.Type.Close:
            self.close_canvas()
        return super().eventFilter(watched, event)

    def close_canvas(self) -> None:
        """Take the second viewer apart."""
        if self._closed:
            return
        self._closed = True
        self._list_timer.stop()
        self._fit_timer.stop()
        self.session.finished.disconnect(self._on_atlas)
        self.session.steps_changed.disconnect(self._update)
        viewer = self._viewer()
        if viewer is not None:
            viewer.events.theme.disconnect(self._on_theme)
        self.cursor.close()
        self._lighting.close()
        self.requested.close()
        self.colouring.close()
        self.depth_bar.close_bar()
        self.model.layers.clear()
        self.qt_viewer.close()
        self.qt_viewer.deleteLater()
        # Whoever still holds this widget must not hold napari's.
        del self.qt_viewer, self.controls, self.layer_list, self.pages
        if viewer is not None:
            _CANVASES.pop(viewer, None)


_CANVASES: weakref.WeakKeyDictionary[Any, UnwrappedCanvas] = weakref.WeakKeyDictionary()


def open_canvas(viewer: Any) -> UnwrappedCanvas | None:
    """The second canvas of a viewer, None while it has none."""
    return _CANVASES.get(getattr(viewer, "__wrapped__", viewer))


def canvas_of(viewer: Any) -> UnwrappedCanvas:
    """The second canvas of a viewer; opened when it is first asked for.

    Parameters
    ----------
    viewer : napari.Viewer
        Or the proxy of it that napari hands to plugins.
    """
    viewer = getattr(viewer, "__wrapped__", viewer)
    for _ in opening(viewer):
        pass
    return _CANVASES[viewer]


def opening(viewer: Any) -> Iterator[None]:
    """Do in pieces what :func:`canvas_of` does for a viewer without a second canvas."""
    from ..session import session_of
    from .showing import add_shown_bar

    if viewer in _CANVASES:
        return
    canvas = _CANVASES[viewer] = UnwrappedCanvas(viewer, session_of(viewer))
    yield
    _dock(viewer, canvas)
    yield
    add_shown_bar(viewer)
    yield


def _dock(viewer: Any, canvas: UnwrappedCanvas) -> None:
    window = viewer.window._qt_window
    # The wizard and the layer list keep their full height.
    window.setCorner(Qt.Corner.BottomLeftCorner, Qt.DockWidgetArea.LeftDockWidgetArea)
    window.setCorner(Qt.Corner.BottomRightCorner, Qt.DockWidgetArea.RightDockWidgetArea)
    window.setCorner(Qt.Corner.TopLeftCorner, Qt.DockWidgetArea.LeftDockWidgetArea)
    window.setCorner(Qt.Corner.TopRightCorner, Qt.DockWidgetArea.RightDockWidgetArea)
    dock = viewer.window.add_dock_widget(
        canvas, name=DOCK_NAME, area="bottom", allowed_areas=["bottom"]
    )
    # Undocked it would lose its OpenGL context; napari's title bar offers just that.
    dock.setFeatures(QDockWidget.DockWidgetFeature.NoDockWidgetFeatures)
    dock.setTitleBarWidget(QWidget())
    window.installEventFilter(canvas)
    window.resizeDocks([dock], [round(SHARE_OF_HEIGHT * window.height())], Qt.Orientation.Vertical)
