"""The paper's tracker: boxes that drift, jump, vanish for a while, and cross seam and poles."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

import napari_unwrap3d as unwrap3d
from moving import CENTRE_UM, DIRECTIONS, RADIUS_UM
from napari_unwrap3d.charts import FrameProtrusions
from napari_unwrap3d.tracking.box_tracker import moved_by, track_boxes
from napari_unwrap3d.tracking.boxes import Box, bounding_boxes
from napari_unwrap3d.unwrapping.uv import pixel_grid, uv_to_direction

ROWS = 64
TIMEPOINTS = 4


@pytest.fixture(scope="module")
def there(movie: unwrap3d.Movie) -> tuple[float, float]:
    """Where the bump of the third timepoint stands in the image."""
    direction = CENTRE_UM + 0.99 * RADIUS_UM * DIRECTIONS[2]
    (v, u) = movie.common.map(direction[None], "volume", "uv")[0][0]
    return float(v), float(u)


def spot(place: tuple[float, float], radius_px: float = 8.0) -> npt.NDArray[np.bool_]:
    """The pixels of a disk on the sphere around a (v, u)."""
    grid = uv_to_direction(pixel_grid(ROWS).reshape(-1, 2), ROWS)
    cosine = grid @ uv_to_direction(np.array([place], float), ROWS)[0]
    return (cosine > np.cos(radius_px * np.pi / ROWS)).reshape(ROWS, 2 * ROWS)


def detected(timepoint: int, spots: dict[int, npt.NDArray[np.bool_]]) -> FrameProtrusions:
    labels = np.zeros((ROWS, 2 * ROWS), np.int32)
    for label, region in spots.items():
        labels[region] = label
    names = np.array(sorted(spots), np.int64)
    columns = {
        "label": names,
        "area_um2": 10.0 * names,
        "motif": np.array(["bleb"] * len(names), dtype=object),
    }
    return FrameProtrusions(timepoint, np.zeros(1, np.int32), labels, columns)


def parameters(**groups: dict[str, object]) -> unwrap3d.Parameters:
    return unwrap3d.Parameters.from_dict(groups)


@pytest.mark.parametrize(
    "places",
    [
        [(20, 124), (20, 126), (20, 0), (20, 2)],  # over the seam
        [(3, 20), (1, 20), (1, 84), (3, 84)],  # over the north pole
        [(60, 100), (62, 100), (62, 36), (60, 36)],  # over the south pole
    ],
)
def test_a_box_keeps_its_track_over_seam_and_poles(
    movie: unwrap3d.Movie, places: list[tuple[float, float]]
) -> None:
    # Labels change from timepoint to timepoint, as those of protrusions do.
    found = [
        detected(t, {1 + t % 2: spot(place), 2 - t % 2: spot((32, 60))})
        for t, place in enumerate(places)
    ]
    tracks = track_boxes(movie, found, parameters())
    assert len(tracks.ids) == 2
    assert len(tracks) == 2 * TIMEPOINTS
    moving = next(k for k in tracks.ids if tracks.column_of(k, "v_px").std() > 0.1 or k == 0)
    np.testing.assert_array_equal(tracks.column_of(moving, "label"), [1, 2, 1, 2])
    np.testing.assert_array_equal(tracks.column_of(moving, "area_um2"), [10.0, 20.0, 10.0, 20.0])
    assert set(tracks.columns["motif"]) == {"bleb"}
    # Each box is written with its middle in the image, and is that of the protrusion.
    for row in range(len(tracks)):
        box = Box(
            *(tracks.columns[f"{side}_px"][row] for side in ("top", "left", "bottom", "right"))
        )
        own = bounding_boxes(found[tracks.timepoint[row]].uv)[tracks.columns["label"][row]]
        assert box.iou(own, ROWS) == pytest.approx(1.0)
        assert -0.5 <= tracks.columns["v_px"][row] <= ROWS - 0.5


def test_positions_lie_on_the_surface(movie: unwrap3d.Movie, there: tuple[float, float]) -> None:
    found = [detected(t, {1: spot(there)}) for t in range(TIMEPOINTS)]
    tracks = track_boxes(movie, found, parameters())
    for t in range(TIMEPOINTS):
        place = tracks.place_px[t : t + 1]
        surface = movie.frame(t).surface
        apart = np.linalg.norm(surface.vertices - tracks.position_um[t], axis=1).min()
        assert apart < 0.5, place


def test_what_is_lost_for_a_while_is_bridged(
    movie: unwrap3d.Movie, there: tuple[float, float]
) -> None:
    shown = {1: spot(there)}
    found = [detected(t, shown if t in (0, 3) else {}) for t in range(TIMEPOINTS)]
    bridged = track_boxes(movie, found, parameters(tracking={"gap_s": 4.0}))
    np.testing.assert_array_equal(bridged.columns["label"], [1, 0, 0, 1])
    assert np.isnan(bridged.columns["area_um2"][1])
    # Half of its life it has a protrusion: a larger part may be asked for.
    strict = parameters(tracking={"gap_s": 4.0}, boxes={"least_matched": 0.6})
    assert len(track_boxes(movie, found, strict)) == 0
    apart = track_boxes(movie, found, parameters(tracking={"gap_s": 3.9}))
    np.testing.assert_array_equal(apart.track_id, [1, 2])


def test_timepoints_that_were_lost_are_gaps(
    movie: unwrap3d.Movie, there: tuple[float, float]
) -> None:
    found = [detected(t, {1: spot(there)}) for t in (0, 1, 3)]
    tracks = track_boxes(movie, found, parameters(tracking={"gap_s": 4.0}))
    np.testing.assert_array_equal(tracks.timepoint, [0, 1, 2, 3])
    np.testing.assert_array_equal(tracks.columns["label"], [1, 1, 0, 1])
    assert np.isfinite(tracks.position_um).all()


def test_short_and_flat_tracks_are_left_out(
    movie: unwrap3d.Movie, there: tuple[float, float]
) -> None:
    found = [detected(t, {1: spot(there)} if t < 2 else {}) for t in range(TIMEPOINTS)]
    assert len(track_boxes(movie, found, parameters())) == 2
    long = parameters(tracking={"least_lifetime_s": 4.1})
    assert len(track_boxes(movie, found, long)) == 0
    curvature = track_boxes(movie, found, parameters()).columns["box_mean_curvature_per_um"].mean()
    for least, rows in ((curvature - 1e-6, 2), (curvature + 1e-6, 0)):
        chosen = parameters(tracking={"least_curvature_per_um": float(least)})
        assert len(track_boxes(movie, found, chosen)) == rows


def test_a_box_that_jumps_in_size_is_interpolated(
    movie: unwrap3d.Movie, there: tuple[float, float]
) -> None:
    sizes = [5.0, 5.0, 9.0, 5.0]
    found = [detected(t, {1: spot(there, size)}) for t, size in enumerate(sizes)]
    chosen = parameters(boxes={"largest_jump_um2": 4.5})
    tracks = track_boxes(movie, found, chosen)
    assert tracks.numbers["repaired_boxes"] == 1
    for side in ("top_px", "left_px", "bottom_px", "right_px"):
        assert np.ptp(tracks.columns[side]) == 0
    kept = track_boxes(movie, found, parameters(boxes={"largest_jump_um2": 1e6}))
    assert np.ptp(kept.columns["top_px"]) > 0


def test_no_protrusions_make_no_tracks(movie: unwrap3d.Movie) -> None:
    for found in ([], [detected(t, {}) for t in range(TIMEPOINTS)]):
        tracks = track_boxes(movie, found, parameters())
        assert len(tracks) == 0
        assert tracks.method == "boxes"


def test_a_box_moves_and_grows_with_the_flow() -> None:
    flow = np.zeros((ROWS, 2 * ROWS, 2))
    flow[..., 0], flow[..., 1] = 2.0, -3.0
    assert moved_by(Box(20, 40, 30, 50), flow) == Box(22, 37, 32, 47)
    # Everything moves away from the middle of the box.
    v, u = pixel_grid(ROWS)[..., 0], pixel_grid(ROWS)[..., 1]
    away = np.stack([0.4 * (v - 24.5), 0.4 * (u - 44.5)], axis=-1)
    grown = moved_by(Box(20, 40, 30, 50), away)
    assert grown.area > 100
    assert grown.centre == pytest.approx((24.5, 44.5))
    # Over the pole, what moves to the pole on the far side moves away from it on this one.
    flow[..., 0], flow[..., 1] = -2.0, 0.0
    flow[:, :ROWS] = 2.0 * np.array([1.0, 0.0])
    over = moved_by(Box(-6, 5, 6, 15), flow)
    assert over == Box(-4, 5, 8, 15)
