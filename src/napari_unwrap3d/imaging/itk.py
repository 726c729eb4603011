"""Registration by SimpleITK (Lowekamp et al. 2013, doi:10.3389/fninf.2013.00045).

Always on one thread, which makes results the same bit for bit. ITK counts axes as (x, y, z).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Volume
from ..geometry.rigid import Rigid
from ..progress import Progress

Metric = Literal["correlation", "mutual information"]
Bools = npt.NDArray[np.bool_]

# Voxels per node of the coarser and the finer level, and the σ of their blur in voxels.
SHRINK = {"correlation": (6, 3), "mutual information": (2, 1)}
BLUR = {"correlation": (6.0, 3.0), "mutual information": (2.0, 0.0)}
# First and last step in voxels, and how many steps.
FIRST_STEP = {"correlation": 2.0, "mutual information": 1.0}
LAST_STEP = {"correlation": 0.2, "mutual information": 0.002}
STEPS = 100
BINS = 24
FLIP = np.eye(3)[::-1]


def best_motion(
    fixed: Volume,
    moving: Volume,
    region: Bools,
    start: Rigid,
    metric: Metric,
    progress: Progress,
    *,
    rotate: bool,
) -> Rigid:
    """The rigid motion from the moving volume's world to the fixed one's.

    Parameters
    ----------
    fixed, moving : Volume
        On cubic voxels of one size.
    region : ndarray, (z, y, x) bool
        The voxels of `fixed` that count.
    start : Rigid
    metric : str
        "correlation", whatever the brightness; "mutual information" (Mattes et al. 2003,
        doi:10.1109/TMI.2003.809072), whatever is bright in either.
    progress : Progress
        A registration is stopped between two of its steps.
    rotate : bool
        Whether the motion turns, too; else it shifts.
    """
    sitk = _simple_itk()
    edge = fixed.voxel_size[0]
    method = sitk.ImageRegistrationMethod()
    method.SetNumberOfThreads(1)
    if metric == "correlation":
        method.SetMetricAsCorrelation()
    else:
        method.SetMetricAsMattesMutualInformation(BINS)
    method.SetMetricFixedMask(_image(region.astype(np.uint8), fixed))
    method.SetInterpolator(sitk.sitkLinear)
    method.SetShrinkFactorsPerLevel(SHRINK[metric])
    method.SetSmoothingSigmasPerLevel([sigma * edge for sigma in BLUR[metric]])
    method.SmoothingSigmasAreSpecifiedInPhysicalUnitsOn()
    method.SetOptimizerAsRegularStepGradientDescent(
        learningRate=FIRST_STEP[metric] * edge,
        minStep=LAST_STEP[metric] * edge,
        numberOfIterations=STEPS,
        gradientMagnitudeTolerance=1e-10,
    )
    index = np.argwhere(region)
    centre = fixed.to_world(index.mean(axis=0)[None])[0]
    transform = _transform(start, centre, rotate)
    if rotate:
        # A radian moves the region's points by their mean distance from its middle.
        radius = float(np.sqrt(((index - index.mean(axis=0)) ** 2).sum(axis=1).mean())) * edge
        method.SetOptimizerScales([radius**2] * 3 + [1.0] * 3)
    method.SetInitialTransform(transform, inPlace=True)
    _follow(method, progress)
    images = _image(fixed.data, fixed), _image(moving.data, moving)
    progress.run(_execute, method, images)
    progress.check()
    return _rigid(transform)


def _simple_itk() -> Any:
    """The library, imported when it is needed; it declares no types."""
    import SimpleITK

    return SimpleITK


def _execute(method: Any, images: tuple[Any, Any]) -> None:
    method.Execute(*images)


def _follow(method: Any, progress: Progress) -> None:
    """Stop after a step where the user asked to; ITK takes no exception from a callback."""
    sitk = _simple_itk()

    def stop_if_asked() -> None:
        if progress.cancelled.is_set():
            method.StopRegistration()

    command: Callable[[], None] = stop_if_asked
    method.AddCommand(sitk.sitkIterationEvent, command)


def _image(data: npt.NDArray[Any], like: Volume) -> Any:
    sitk = _simple_itk()
    image = sitk.GetImageFromArray(np.ascontiguousarray(data))
    image.SetSpacing([float(s) for s in like.voxel_size[::-1]])
    image.SetOrigin([float(o) for o in like.origin[::-1]])
    return image


def _transform(start: Rigid, centre: Floats, rotate: bool) -> Any:
    """ITK's transforms map the points of the fixed image into the moving one."""
    sitk = _simple_itk()
    back = start.inverse()
    if not rotate:
        return sitk.TranslationTransform(3, [float(t) for t in back.translation[::-1]])
    transform = sitk.Euler3DTransform()
    transform.SetCenter([float(c) for c in centre[::-1]])
    transform.SetMatrix((FLIP @ back.rotation @ FLIP).ravel().tolist())
    shift = back.apply(centre) - centre
    transform.SetTranslation([float(s) for s in shift[::-1]])
    return transform


def _rigid(transform: Any) -> Rigid:
    name = transform.GetName()
    if name == "TranslationTransform":
        return Rigid(np.eye(3), np.array(transform.GetOffset())[::-1]).inverse()
    matrix = FLIP @ np.array(transform.GetMatrix()).reshape(3, 3) @ FLIP
    centre = np.array(transform.GetCenter())[::-1]
    shift = np.array(transform.GetTranslation())[::-1]
    return Rigid.about(centre, matrix, shift).inverse()
