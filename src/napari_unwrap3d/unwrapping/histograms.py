"""How angles and areas are distorted, as histograms to look at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..charts import UV, Floats, Reference, Sphere
from ..geometry.distortion import area_distortion, conformal_error
from ..geometry.mesh import face_areas

BINS = 40
TAILS = (0.005, 0.995)


@dataclass(frozen=True, eq=False)
class Histogram:
    """Shares (k,) of the area, or of the pixels, between edges (k + 1,), and the mean."""

    shares: Floats
    edges: Floats
    mean: float


def sphere_histograms(reference: Reference, chart: Sphere) -> dict[str, Histogram]:
    """Of log λ and of Q over the faces of the sphere, weighted by the reference's area."""
    source, target, faces = reference.vertices, chart.vertices, chart.faces
    weights = face_areas(source, faces)
    log_lambda = np.log(np.maximum(area_distortion(source, target, faces), 1e-300))
    return _histograms(log_lambda, conformal_error(source, target, faces), weights)


def uv_histograms(chart: UV) -> dict[str, Histogram]:
    """Of log λ and of Q over the pixels of the uv image, weighted by their area."""
    log_lambda = np.log(np.maximum(chart.fields["area_distortion"], 1e-300))
    return _histograms(log_lambda, chart.fields["conformal_error"], chart.fields["area_um2"])


def _histograms(log_lambda: Floats, q: Floats, weights: Floats) -> dict[str, Histogram]:
    return {
        "log_lambda": histogram(log_lambda.ravel(), weights.ravel()),
        "q": histogram(q.ravel(), weights.ravel()),
    }


def histogram(values: Floats, weights: Floats, bins: int = BINS) -> Histogram:
    """A weighted histogram from the 0.5th to the 99.5th percentile; the rest counts at the ends.

    The percentiles are of the weight: the many small pixels at the poles are few there.
    """
    known = np.isfinite(values) & (weights > 0)
    values, weights = values[known].astype(float), weights[known].astype(float)
    low, high = _percentiles(values, weights) if len(values) else (0.0, 1.0)
    if high - low < 1e-6:
        low, high = low - 0.5e-3, high + 0.5e-3
    edges = np.linspace(low, high, bins + 1)
    total = weights.sum() if len(weights) else 1.0
    shares, _ = np.histogram(np.clip(values, low, high), edges, weights=weights / total)
    mean = float(values @ weights / total) if len(values) else float("nan")
    return Histogram(shares, edges, mean)


def _percentiles(values: Floats, weights: Floats) -> tuple[float, float]:
    order = np.argsort(values)
    reached = np.cumsum(weights[order])
    low, high = np.searchsorted(reached, np.multiply(reached[-1], TAILS))
    return float(values[order[low]]), float(values[order[high]])
