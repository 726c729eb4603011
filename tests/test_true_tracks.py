"""The true tracks of a simulated movie are where its truth has the protrusions."""

from __future__ import annotations

import numpy as np

from napari_unwrap3d import simulate
from napari_unwrap3d.simulate.true_tracks import true_tracks


def test_true_tracks_follow_every_protrusion_in_either_world() -> None:
    movie = simulate.movie("blebs", seed=3, size=80, timepoints=3)
    own, moved = true_tracks(movie), true_tracks(movie, "stack")
    assert set(own.ids) == set(movie.courses["id"])
    assert len(own) == len(movie.courses)
    truth = movie.truth(2)
    rows = own.timepoint == 2
    expected = truth.protrusions.set_index("id").loc[own.track_id[rows]]
    np.testing.assert_allclose(own.position_um[rows], expected[["z_um", "y_um", "x_um"]])
    np.testing.assert_allclose(own.columns["height_um"][rows], expected["height_um"])
    # In the stack they have drifted with the cell.
    back = truth.pose.apply(moved.position_um[rows])
    np.testing.assert_allclose(back, own.position_um[rows], atol=1e-9)
    assert np.abs(moved.position_um[rows] - own.position_um[rows]).max() > 0.1
