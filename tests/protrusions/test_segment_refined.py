"""When the refinement is applied."""

from __future__ import annotations

import sys
from types import ModuleType

import numpy as np
import pytest

from blebbed import bleb_labels, blebbed_mask, blebbed_surface
from napari_unwrap3d.parameters import Parameters
from napari_unwrap3d.progress import silent
from napari_unwrap3d.protrusions import segment
from napari_unwrap3d.protrusions.segment import Segmentation, segment_cell


@pytest.mark.parametrize(
    ("apply", "kind", "split"),
    [
        ("never", "blebs", False),
        ("blebs", "blebs", True),
        ("blebs", "filopodia", False),
        ("always", "filopodia", True),
    ],
)
def test_it_is_applied_where_it_is_asked_for(monkeypatch, apply, kind, split):
    mask, surface = blebbed_mask(), blebbed_surface()
    labels = np.array([0, 1, 1, 2], np.int32)[bleb_labels(mask.to_index(surface.vertices))]
    volume = np.zeros(mask.data.shape, np.int32)
    found = Segmentation(labels, np.zeros(len(labels)), volume, mask.data, {"kind": kind})
    method = ModuleType("over_cortex")
    method.over_cortex = lambda *_: found  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "napari_unwrap3d.protrusions.over_cortex", method)
    monkeypatch.setattr(segment, "measured", lambda found, *_, **__: found)

    class Topography:
        surface = None
        shape = (1, 32, 64)

    charts = {"mask": mask, "surface": surface, "topography": Topography}
    parameters = Parameters.from_dict({"refinement": {"apply": apply}})
    result = segment_cell(charts.__getitem__, parameters, silent())
    assert (len(np.unique(result.labels)) == 4) == split
