"""Smoothing of a uv image as the sphere continues: Garcia's robust splines, and a box.

Garcia (2010), "Robust smoothing of gridded data in one and higher dimensions with missing
values", doi:10.1016/j.csda.2009.09.020. There the discrete cosine transform mirrors the
borders; here the image is continued over the poles half a turn away to a doubly periodic
one, on which the Fourier transform does the same.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import fft, ndimage
from scipy.optimize import minimize_scalar

from .padding import pad_sphere

Floats = npt.NDArray[np.float64]

# log10 s is searched between these, as fine as this.
LOG_S = (-3.0, 6.0)
LOG_S_TOLERANCE = 0.1
# Rounds of reweighting, and of the iteration that a weighted solution needs.
ROBUST_ROUNDS = 3
WEIGHTED_ITERATIONS = 12
WEIGHTED_TOLERANCE = 1e-3
# Tukey's constant, and the factor from the median absolute deviation to a standard deviation.
BISQUARE = 4.685
MAD_TO_SIGMA = 1.4826


def robust_smooth(image: Floats, s: float | None = None) -> tuple[Floats, float]:
    """Penalised least squares with bisquare weights, which outliers do not pull.

    Minimises ``Σ W |ŷ − y|² + s |Δŷ|²``; s by generalised cross-validation unless given. It
    is found before the weights, where Garcia looks for it anew after every reweighting.

    Parameters
    ----------
    image : ndarray, (N, 2N, k)
        Vectors; all components of a pixel have one weight.
    s : float, optional
        Positive; larger is smoother.

    Returns
    -------
    smooth : ndarray, (N, 2N, k)
    s : float
        As given or found.
    """
    values = continued(image)
    penalty = _penalty(values.shape[0], values.shape[1])
    weights = np.ones(values.shape[:2])
    if s is None:
        s = _cross_validated(values, penalty)
    gain = 1.0 / (1.0 + s * penalty)
    smooth = _filtered(values, gain)
    for _ in range(ROBUST_ROUNDS):
        weights = _bisquare(values - smooth, s)
        smooth = _weighted(values, weights, smooth, gain)
    return np.asarray(smooth[: len(image)]), float(s)


def box_smooth(image: Floats, width: int) -> Floats:
    """Mean over a window of width × width pixels of an image (N, 2N, k), width odd."""
    padded = pad_sphere(image, width // 2)
    mean = ndimage.uniform_filter(padded, size=(width, width, 1), mode="nearest")
    margin = width // 2
    inner: Floats = mean[margin : margin + image.shape[0], margin : margin + image.shape[1]]
    return inner


def continued(image: Floats) -> Floats:
    """The image (N, 2N, k) over both poles to a doubly periodic one (2N, 2N, k)."""
    over = np.roll(image, image.shape[1] // 2, axis=1)[::-1]
    return np.concatenate([image, over])


def _penalty(rows: int, columns: int) -> Floats:
    """Squared eigenvalues of the periodic second difference, for the real transform."""
    down = 2.0 * np.cos(2.0 * np.pi * np.arange(rows) / rows) - 2.0
    along = 2.0 * np.cos(2.0 * np.pi * np.arange(columns // 2 + 1) / columns) - 2.0
    squared: Floats = (down[:, None] + along) ** 2
    return squared


def _filtered(values: Floats, gain: Floats) -> Floats:
    spectrum = fft.rfft2(values, axes=(0, 1))
    spectrum *= gain[:, :, None]
    return np.asarray(fft.irfft2(spectrum, s=values.shape[:2], axes=(0, 1)))


def _cross_validated(values: Floats, penalty: Floats) -> float:
    """The s of the smallest generalised cross-validation score, without weights."""
    spectrum = fft.rfft2(values, axes=(0, 1))
    # The half spectrum stands for both halves, but for the columns it shares with itself.
    twice = np.full(penalty.shape, 2.0)
    twice[:, 0] = 1.0
    twice[:, -1] = 1.0
    power = twice * (np.abs(spectrum) ** 2).sum(axis=2)

    def score(log_s: float) -> float:
        gain = 1.0 / (1.0 + 10.0**log_s * penalty)
        trace = (twice * gain).sum() / twice.sum()
        return float((power * (1.0 - gain) ** 2).sum() / max((1.0 - trace) ** 2, 1e-12))

    found = minimize_scalar(
        score, bounds=LOG_S, method="bounded", options={"xatol": LOG_S_TOLERANCE}
    )
    return float(10.0**found.x)


def _bisquare(residual: Floats, s: float) -> Floats:
    """Weights (n, m) by studentised residuals, with the leverage of the whole image."""
    root = np.sqrt(1.0 + 16.0 * s)
    leverage = (np.sqrt(1.0 + root) / np.sqrt(2.0) / root) ** 2
    size = np.linalg.norm(residual, axis=2)
    middle = np.median(residual.reshape(-1, residual.shape[2]), axis=0)
    deviation = np.median(np.linalg.norm(residual - middle, axis=2))
    spread = MAD_TO_SIGMA * deviation * np.sqrt(max(1.0 - leverage, 1e-12))
    if spread <= 1e-300:
        return np.ones(size.shape)
    return np.asarray((1.0 - np.minimum(size / (BISQUARE * spread), 1.0) ** 2) ** 2)


def _weighted(values: Floats, weights: Floats, start: Floats, gain: Floats) -> Floats:
    """Solution with weights: Garcia's fixed point, one transform there and back a round."""
    smooth = start
    for _ in range(WEIGHTED_ITERATIONS):
        last = smooth
        smooth = _filtered(weights[:, :, None] * (values - smooth) + smooth, gain)
        change = float(np.abs(smooth - last).max())
        if change <= WEIGHTED_TOLERANCE * float(np.abs(smooth).max(initial=1e-300)):
            break
    return smooth
