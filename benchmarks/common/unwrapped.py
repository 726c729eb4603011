"""Simulated movies that were unwrapped, with their truth; kept for everything that tracks them.

Unwrapping takes minutes, tracking seconds: movies are made once and kept in benchmarks/cache, or
in the folder that the variable UNWRAP3D_BENCH_CACHE names. Delete it to make them anew.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage
from scipy.optimize import linear_sum_assignment

import napari_unwrap3d as unwrap3d
from napari_unwrap3d.files.atomic import write_json
from napari_unwrap3d.geometry.interpolate import sample_linear
from napari_unwrap3d.geometry.laplacian import vertex_mass
from napari_unwrap3d.provenance import content_hash

HERE = Path(__file__).resolve().parents[1]
VOXEL_UM = 0.15
SIZE = 112
ROWS = 256
DONE = "unwrapped.json"
# A truth label is looked for so far from a vertex; beyond it the vertex is the body's.
REACH_VOXELS = 2.0
LEAST_SHARED = 0.3
# Groups of parameters that nothing of the unwrapping depends on.
AFTERWARDS = {"tracking", "boxes", "flow", "measurement"}


@dataclass(frozen=True, eq=False)
class Unwrapped:
    """A simulated movie and what was made of its recording."""

    truth: Any
    movie: unwrap3d.Movie

    @lru_cache(maxsize=4)  # noqa: B019 - as many as are compared at once
    def truth_at(self, timepoint: int) -> Any:
        return self.truth.truth(timepoint)

    def to_stack(self, points: np.ndarray, timepoint: int) -> np.ndarray:
        """Points (n, 3) of the common world in the world of a timepoint's stack."""
        registered = self.movie.folder.registered(timepoint)
        assert registered is not None
        return registered.pose.inverse().apply(points)

    def identities(self, timepoint: int) -> np.ndarray:
        """The true identity (n,) of every vertex of a timepoint's surface, 0 of the body."""
        vertices = self.to_stack(self.movie.frame(timepoint).surface.vertices, timepoint)
        labels = self.truth_at(timepoint).labels
        distance, nearest = ndimage.distance_transform_edt(labels.data == 0, return_indices=True)
        voxel = np.round(vertices / labels.voxel_size[0]).astype(int)
        voxel = np.clip(voxel, 0, np.array(labels.data.shape) - 1)
        z, y, x = voxel.T
        identity = labels.data[tuple(nearest[:, z, y, x])]
        near_body = sample_linear(
            self.truth_at(timepoint).body.data.astype(np.float32), vertices / labels.voxel_size[0]
        )
        return np.where((distance[z, y, x] <= REACH_VOXELS) & (near_body < 0.5), identity, 0)

    def matched(self, timepoint: int) -> dict[int, int]:
        """Label of a protrusion found at a timepoint → identity, one to one, by shared area."""
        frame = self.movie.frame(timepoint)
        found = self.movie.protrusions(timepoint).labels
        true = self.identities(timepoint)
        area = vertex_mass(frame.surface.vertices, frame.surface.faces)
        names, index = np.unique(true, return_inverse=True)
        count = int(found.max(initial=0)) + 1
        shared = np.bincount(found * len(names) + index, area, count * len(names))
        shared = shared.reshape(count, len(names))
        union = shared.sum(axis=1)[:, None] + shared.sum(axis=0) - shared
        iou = np.where((names > 0) & (np.arange(count) > 0)[:, None], shared / union, 0)
        rows, columns = linear_sum_assignment(-iou)
        good = iou[rows, columns] > LEAST_SHARED
        pairs = zip(rows[good].tolist(), names[columns[good]].tolist(), strict=True)
        return dict(pairs)


def unwrapped(
    kind: str,
    seed: int,
    timepoints: int,
    *,
    rows: int = ROWS,
    size: int = SIZE,
    groups: dict[str, dict[str, Any]] | None = None,
    protrusions: bool = True,
    **simulated: Any,
) -> Unwrapped:
    """A movie of :func:`simulate.movie` and its unwrapping; made if it is not there.

    Parameters
    ----------
    groups : dict
        Further parameters of the unwrapping.
    protrusions : bool
        Whether the protrusions of all timepoints are found, too.
    simulated
        Further arguments of the simulation.
    """
    arguments = {"size": size, "voxel_size": (0.3, VOXEL_UM, VOXEL_UM), **simulated}
    truth = unwrap3d.simulate.movie(kind, seed, timepoints=timepoints, **arguments)
    chosen = {"uv": {"rows": rows}, "stack": {"threshold": "edge"}} | (groups or {})
    parameters = unwrap3d.Parameters.from_dict(chosen)
    key = content_hash(truth.key, parameters.model_dump_json(exclude=AFTERWARDS))[:12]
    cache = Path(os.environ.get("UNWRAP3D_BENCH_CACHE", HERE / "cache"))
    folder = cache / f"{kind}-{seed}-{key}"
    if not (folder / DONE).exists():
        _make(truth, parameters, folder)
    movie = unwrap3d.load_movie(folder)
    if protrusions:
        for timepoint in range(len(movie)):
            movie.protrusions(timepoint)
    return Unwrapped(truth, movie)


def _make(truth: Any, parameters: unwrap3d.Parameters, folder: Path) -> None:
    print(f"unwrapping {truth.kind} {truth.seed}, {len(truth)} timepoints", flush=True)
    unwrap3d.unwrap_movie(truth.stack, parameters, folder=folder).compute()
    write_json(folder / DONE, {})


def main() -> None:
    """Make one movie, e.g. ``common/unwrapped.py blebs 10 60``."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kind")
    parser.add_argument("seed", type=int)
    parser.add_argument("timepoints", type=int)
    options = parser.parse_args()
    unwrapped(options.kind, options.seed, options.timepoints)


if __name__ == "__main__":
    main()
