"""The shape while a slider moves, until the step has been computed anew.

Moving the flow's iteration shows the kept iteration of the sealed surface in a layer of
its own, in place of the meshes there; moving the blend moves the vertices of the sphere's
layer along great circles. Whatever ends the run takes the preview away.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from qtpy.QtCore import QObject

from ...errors import Cancelled
from ...geometry.apart import apart
from ...parameters import Parameters, ReferenceParameters
from ...progress import Progress
from ...unwrapping.preview import FlowPreview, between_blends, flow_preview, iterations_to_keep
from ..common.threads import Task, tell
from ..views.layers import KEY, SPACE, UNIT
from ..views.placing import chart_of, set_vertices

if TYPE_CHECKING:
    from napari.layers import Layer

    from ...atlas import Atlas
    from ...charts import Floats
    from ..session import Session

NAME = "reference (preview)"
WAIT_SECONDS = 5.0
# What the flow's vertices depend on; the stopping rule only chooses among them.
OF_THE_FLOW = ("flow", "laplacian", "mass", "keep_volume", "delta")
COVERING = ("surface", "sealed", "reference", "mask")


@dataclass
class Kept:
    """A flow that was kept, and what it belongs to."""

    sealed: Any
    parameters: tuple[Any, ...]
    preview: FlowPreview


class Previews(QObject):
    """What a session shows while its sliders move."""

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self.session = session
        self.flow: Kept | None = None
        self.blends: dict[float, Floats] = {}
        self._reference: Any = None
        self._before = session.parameters
        self._layer: Layer | None = None
        self._hidden: list[Layer] = []
        self._task: Task | None = None
        self._progress = Progress()
        session.parameters_changed.connect(self._on_parameters)
        session.finished.connect(self._on_finished)
        session.stopped.connect(self._on_stopped)
        session.settled.connect(self._on_stopped)
        session.charts_changed.connect(self._on_charts)
        session.closing.connect(self.close)

    # What is kept ------------------------------------------------------------

    def _on_finished(self, atlas: Atlas) -> None:
        self._end_iteration(exact=True)
        if atlas.has("reference") and atlas.has("sphere"):
            self._keep_blend(atlas)
        if atlas.has("sealed") and atlas.has("reference"):
            self._keep_flow(atlas)

    def _keep_blend(self, atlas: Atlas) -> None:
        if self._reference is not atlas.reference:
            self._reference, self.blends = atlas.reference, {}
        sphere = atlas.sphere
        self.blends |= {
            0.0: sphere.conformal.astype(np.float32),
            float(sphere.blend): sphere.vertices.astype(np.float32),
        }

    def _keep_flow(self, atlas: Atlas) -> None:
        parameters = self.session.parameters.reference
        same = self.flow is not None and self._is_of(self.flow, atlas.sealed, parameters)
        if same or parameters.skip or self._task is not None or atlas.sealed.mask is None:
            return
        count = iterations_to_keep(parameters, atlas.reference.iteration)
        self._progress = Progress()
        self._task = Task(self._compute_flow, atlas.sealed, parameters, count, self._progress)
        self._task.returned.connect(self._on_flow)
        self._task.failed.connect(self._on_no_flow)
        self._task.start()

    @staticmethod
    def _compute_flow(
        sealed: Any, parameters: ReferenceParameters, count: int, progress: Progress
    ) -> Kept:
        with apart():
            preview = flow_preview(sealed, parameters, count, progress)
        return Kept(sealed, _of_the_flow(parameters), preview)

    @staticmethod
    def _is_of(kept: Kept, sealed: Any, parameters: ReferenceParameters) -> bool:
        return kept.sealed is sealed and kept.parameters == _of_the_flow(parameters)

    def _on_flow(self, kept: Kept) -> None:
        self._task, self.flow = None, kept

    def _on_no_flow(self, error: BaseException) -> None:
        self._task = None
        if not isinstance(error, Cancelled):
            tell(error)

    # What is shown -----------------------------------------------------------

    def _on_parameters(self, parameters: Parameters) -> None:
        before, self._before = self._before, parameters
        reference = parameters.reference
        moved = reference.fixed_iteration != before.reference.fixed_iteration
        if moved and reference.stop == "fixed":
            self.show_iteration(reference.fixed_iteration)
        if parameters.sphere.blend != before.sphere.blend:
            self.show_blend(parameters.sphere.blend)

    def show_iteration(self, iteration: int) -> bool:
        """Show a kept iteration of the flow; False if there is none."""
        viewer, kept = self.session.viewer, self.flow
        sealed = self.session.charts.get("sealed")
        if viewer is None or kept is None:
            return False
        if not self._is_of(kept, sealed, self.session.parameters.reference):
            return False
        vertices = kept.preview.at(iteration)
        if self._layer is None or self._layer not in viewer.layers:
            self._add_layer(vertices, kept.preview.faces)
        else:
            self._layer.vertices = vertices
        return True

    def _add_layer(self, vertices: Any, faces: Any) -> None:
        viewer = self.session.viewer
        assert viewer is not None
        self._hidden = [
            layer for layer in viewer.layers if chart_of(layer) in COVERING and layer.visible
        ]
        for layer in self._hidden:
            layer.visible = False
        chosen = set(viewer.layers.selection)
        reference = self._layer_of("reference")
        self._layer = viewer.add_surface(
            (vertices, faces),
            name=NAME,
            units=(UNIT,) * 3,
            axis_labels=SPACE,
            translate=(0.0, 0.0, 0.0) if reference is None else reference.translate[-3:],
            shading="smooth",
            colormap="gray",
            contrast_limits=(0.0, 1.2),
            metadata={KEY: {"layer": NAME, "chart": "", "field": ""}},
        )
        viewer.layers.selection = chosen

    def show_blend(self, blend: float) -> bool:
        """Show the sphere at a blend; False if its states are not known."""
        layer = self._layer_of("sphere")
        if layer is None or len(self.blends) < 2:
            return False
        return set_vertices(layer, between_blends(self.blends, blend))

    def _layer_of(self, name: str) -> Layer | None:
        viewer = self.session.viewer
        every = [] if viewer is None else viewer.layers
        return next(
            (each for each in every if each.metadata.get(KEY, {}).get("layer") == name), None
        )

    # What ends it ------------------------------------------------------------

    def _on_stopped(self, _: str = "") -> None:
        """No new result came: the charts are shown as they are."""
        self._end_iteration(exact=False)
        sphere, layer = self.session.charts.get("sphere"), self._layer_of("sphere")
        if sphere is not None and layer is not None:
            set_vertices(layer, sphere.vertices.astype(np.float32))

    def _on_charts(self, charts: dict[str, Any]) -> None:
        """The exact reference has come, or those of another cell."""
        new = "reference" in charts and charts["reference"] is not self._reference
        if new or not charts:
            self._end_iteration(exact=new)

    def _end_iteration(self, *, exact: bool) -> None:
        """Take the preview away; the exact reference takes its place, or what was there before."""
        viewer, layer = self.session.viewer, self._layer
        self._layer = None
        if viewer is None or layer is None or layer not in viewer.layers:
            return
        viewer.layers.remove(layer)
        reference = self._layer_of("reference")
        if exact and reference is not None:
            reference.visible = True
        else:
            for hidden in self._hidden:
                hidden.visible = True
        self._hidden = []

    def close(self) -> None:
        """End the thread."""
        self._progress.cancel()
        if self._task is not None:
            self._task.wait(WAIT_SECONDS)


def _of_the_flow(parameters: ReferenceParameters) -> tuple[Any, ...]:
    return tuple(getattr(parameters, name) for name in OF_THE_FLOW)
