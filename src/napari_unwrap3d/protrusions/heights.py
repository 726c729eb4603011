"""Heights of the surface over the cortex, as a histogram to choose a threshold from."""

from __future__ import annotations

from ..charts import Protrusions, Surface
from ..geometry.laplacian import vertex_mass
from ..unwrapping.histograms import Histogram, histogram


def height_histogram(found: Protrusions, surface: Surface) -> Histogram:
    """Shares of the surface's area by height over the cortex in µm, all labels together."""
    return histogram(found.height_um, vertex_mass(surface.vertices, surface.faces))
