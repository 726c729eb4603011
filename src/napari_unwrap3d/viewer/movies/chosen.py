"""The timelapse of one viewer: its layers, and what a person filled in about them."""

from __future__ import annotations

import weakref
from typing import Any

from qtpy.QtCore import QObject, Signal

from ...charts import Size3
from ...motion.timelapse import Timelapse
from ...parameters import Parameters
from ..session import ASK_VOXEL_SIZE
from ..views.sources import layer_voxel_size, set_voxel_size
from .sources import Candidate, candidates, set_time_step, timelapse_of

NO_TIMELAPSE = (
    "Open a timelapse: a stack or label image with a t axis, or several masks or meshes, one for "
    "each timepoint (or File > Open Sample)."
)
ASK_TIME_STEP = "Fill in the time between two timepoints in s."


class ChosenTimelapse(QObject):
    """Which layers of a viewer are the timelapse; the first that can be, until one is chosen.

    Attributes
    ----------
    source : Candidate or None
        The layers of the timelapse.

    Signals
    -------
    changed(bool)
        Other layers (True), or another voxel size or time step of them.
    listed()
        What can be chosen.
    """

    changed = Signal(bool)
    listed = Signal()

    def __init__(self, viewer: Any, parent: QObject) -> None:
        super().__init__(parent)
        self._viewer = weakref.ref(viewer)
        self.source: Candidate | None = None
        self._voxel_size: Size3 | None = None
        self._time_step: float | None = None
        self._closed = False
        for name in ("inserted", "removed"):
            getattr(viewer.layers.events, name).connect(self._on_layers)
        self._choose_first()

    def candidates(self) -> list[Candidate]:
        """What can be a timelapse."""
        viewer = self._viewer()
        return [] if viewer is None else candidates(viewer.layers)

    def choose(
        self,
        source: Candidate | None,
        voxel_size: Size3 | None = None,
        time_step: float | None = None,
    ) -> None:
        """Choose the timelapse.

        Parameters
        ----------
        source : Candidate or None
        voxel_size : (float, float, float), optional
            (z, y, x) in µm, for layers in pixels.
        time_step : float, optional
            Seconds between two timepoints, where the layer does not tell.
        """
        another = source != self.source
        if not another and (voxel_size, time_step) == (self._voxel_size, self._time_step):
            return
        self.source, self._voxel_size, self._time_step = source, voxel_size, time_step
        self.changed.emit(another)

    @property
    def voxel_size(self) -> Size3 | None:
        """(z, y, x) in µm: the layer's own, or what was filled in."""
        known = None if self.source is None else self.source.voxel_size
        return known if known is not None else self._voxel_size

    @property
    def time_step(self) -> float | None:
        """Seconds between two timepoints: the layer's own, or what was filled in."""
        known = None if self.source is None else self.source.time_step
        return known if known is not None else self._time_step

    def blocked(self) -> str:
        """Why nothing can run, in words for the user; empty if it can."""
        if self.source is None:
            return NO_TIMELAPSE
        if self.voxel_size is None:
            return ASK_VOXEL_SIZE
        return "" if self.time_step else ASK_TIME_STEP

    def _on_layers(self, _: Any = None) -> None:
        if self._closed:
            return
        viewer = self._viewer()
        if viewer is None:
            return
        gone = self.source is not None and any(
            layer not in viewer.layers for layer in self.source.layers
        )
        if gone:
            self.choose(None)
        if self.source is None:
            self._choose_first()
        else:
            self._grow(self.source)
        self.listed.emit()

    def _grow(self, source: Candidate) -> None:
        """Masks or meshes come one by one, each of them a timepoint."""
        chosen = set(source.layers)
        for each in self.candidates() if len(chosen) > 1 else ():
            if chosen < set(each.layers):
                self.choose(each, self._voxel_size, self._time_step)

    def _choose_first(self) -> None:
        found = self.candidates()
        if found:
            self.choose(found[0])

    def labelled(self, parameters: Parameters) -> Parameters:
        """The parameters, with a label where the timelapse is of labels."""
        label = parameters.stack.label
        if self.source is None or not self.source.is_of_labels:
            label = None
        elif label is None:
            label = max(int(self.source.layers[0].selected_label), 1)
        if label == parameters.stack.label:
            return parameters
        stack = parameters.stack.model_copy(update={"label": label})
        return parameters.model_copy(update={"stack": stack})

    def read(self) -> tuple[Timelapse, Size3]:
        """The timelapse, and where it lies; what was filled in is written into the layers.

        Raises
        ------
        Unwrap3DError
            The layers cannot be a timelapse.
        """
        assert self.source is not None
        voxel_size, step = self.voxel_size, self.time_step
        lapse = timelapse_of(self.source, voxel_size, step)
        for layer in self.source.layers:
            if layer_voxel_size(layer) is None and voxel_size is not None:
                set_voxel_size(layer, voxel_size)
        if len(self.source.layers) == 1 and self.source.time_step is None and step is not None:
            set_time_step(self.source.layers[0], step)
        return lapse

    def close(self) -> None:
        """Look at the viewer's layers no more."""
        self._closed = True
        self.source = None
        viewer = self._viewer()
        if viewer is not None:
            for name in ("inserted", "removed"):
                getattr(viewer.layers.events, name).disconnect(self._on_layers)
