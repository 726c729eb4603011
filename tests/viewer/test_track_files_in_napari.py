"""Tracks open as layers, and tracks layers of anyone are saved, through napari's own doors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import npe2
import numpy as np
import pandas as pd
import pytest
from napari.layers import Layer

import napari_unwrap3d
from napari_unwrap3d.charts import Tracks
from napari_unwrap3d.errors import InputError
from napari_unwrap3d.files.tracks import FORMATS, read_tracks, write_tracks
from napari_unwrap3d.viewer.files.readers import get_tracks_reader
from napari_unwrap3d.viewer.files.writers import write_tracks_layer
from napari_unwrap3d.viewer.views.layers import KEY

MANIFEST = Path(napari_unwrap3d.__file__).parent / "napari.yaml"
COLUMNS = {
    "track_id": [1, 1, 1, 2, 2, 4],
    "timepoint": [0, 1, 3, 2, 3, 3],
    "z_um": [0.5, 1.25, 2.0, 7.0, 8.0, 3.0],
    "y_um": [1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
    "x_um": [9.0, 8.0, 7.0, 6.0, 5.0, 4.0],
    "v_px": [3.0, 4.0, 5.0, 6.0, 7.0, 8.0],
    "u_px": [1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
    "area_um2": [1.5, 2.5, 3.5, 4.5, 5.5, 6.5],
}


@pytest.fixture
def tracks() -> Tracks:
    return Tracks.of(
        COLUMNS,
        time_step_s=2.5,
        timepoints=4,
        rows=32,
        splits=np.array([(1, 2)]),
        method="surface",
        numbers={"linked": 5},
    )


def opened(path: Path) -> Layer:
    reader = get_tracks_reader(str(path))
    assert reader is not None
    (data,) = reader(str(path))
    return Layer.create(*data)


def saved(path: Path, layer: Layer) -> Tracks:
    data, attributes, kind = layer.as_layer_data_tuple()
    assert kind == "tracks"
    assert write_tracks_layer(str(path), data, attributes) == [str(path)]
    return read_tracks(path)


@pytest.mark.parametrize("suffix", FORMATS.values())
def test_tracks_of_every_format_open_where_they_are_and_are_saved_again(
    tracks: Tracks, tmp_path: Path, suffix: str
) -> None:
    layer = opened(write_tracks(tmp_path / f"some{suffix}", tracks))
    assert layer.name == "some"
    world = np.column_stack([layer.data[:, 0], layer.data[:, 1:] * layer.scale + layer.translate])
    expected = np.column_stack([tracks.track_id, tracks.times_s, tracks.position_um])
    assert np.allclose(world, expected)
    assert [str(unit) for unit in layer.units] == ["second", *["micrometer"] * 3]
    assert layer.graph == {2: [1]}
    assert np.array_equal(layer.features["area_um2"], tracks.columns["area_um2"])
    again = saved(tmp_path / f"again{suffix}", layer)
    assert again.time_step_s == tracks.time_step_s
    assert again.splits.tolist() == tracks.splits.tolist()
    names = [name for name in tracks.columns if name in again.columns]
    assert set(names) >= set(COLUMNS)
    pd.testing.assert_frame_equal(again.table[names], tracks.table[names], check_dtype=False)


def test_a_layer_of_this_package_is_saved_with_all_that_is_known(
    tracks: Tracks, tmp_path: Path
) -> None:
    """Also the one on the image, whose lines are cut and whose places are pixels."""
    cut = np.array([(1, 0, 0, 3, 1), (1, 1, 0, 4, 2), (7, 1, 0, 4, 60)], float)
    layer = Layer.create(cut, {"metadata": {KEY: {"tracks": tracks}}}, "tracks")
    again = saved(tmp_path / "ours.geff", layer)
    pd.testing.assert_frame_equal(again.table, tracks.table)
    assert again.rows == tracks.rows
    assert again.numbers["linked"] == 5


def test_layers_of_others_are_saved_in_micrometres_where_they_are_shown(tmp_path: Path) -> None:
    data = np.array([(0, 2, 1, 1), (0, 3, 2, 2), (5, 4, 1, 0), (6, 4, 0, 1)], float)
    attributes: dict[str, Any] = {
        "scale": (2, 100, 50),
        "translate": (0, 1000, 0),
        "units": ("minute", "nm", "nm"),
        "graph": {5: [0], 6: [0]},
        "features": {"size": [1.0, 2.0, 3.0, 4.0]},
    }
    again = saved(tmp_path / "plane.csv", Layer.create(data, attributes, "tracks"))
    assert again.time_step_s == 120
    assert again.track_id.tolist() == [1, 1, 6, 7]
    assert again.timepoint.tolist() == [2, 3, 4, 4]
    expected = [(0, 1.1, 0.05), (0, 1.2, 0.1), (0, 1.1, 0), (0, 1.0, 0.05)]
    assert np.allclose(again.position_um, expected)
    assert again.splits.tolist() == [[1, 6], [1, 7]]
    merged = attributes | {"graph": {6: [0, 5]}}
    again = saved(tmp_path / "merged.csv", Layer.create(data, merged, "tracks"))
    assert again.merges.tolist() == [[1, 7], [6, 7]]


def test_a_layer_without_a_unit_of_time_or_that_is_turned_is_refused(tmp_path: Path) -> None:
    data = np.array([(1, 0, 1, 1, 1), (1, 1, 2, 2, 2)], float)
    turned = np.eye(5)
    turned[2:4, 2:4] = [(0, -1), (1, 0)]
    for attributes, words in (
        ({"units": ("pixel", *["um"] * 3)}, "how long a timepoint is"),
        ({"units": ("s", *["um"] * 3), "affine": turned}, "rotated"),
    ):
        layer = Layer.create(data, attributes, "tracks")
        with pytest.raises(InputError, match=words):
            saved(tmp_path / "no.csv", layer)
    half = Layer.create(data + np.array([0, 0.5, 0, 0, 0]), {"units": ("s", *["um"] * 3)}, "tracks")
    with pytest.raises(InputError):
        saved(tmp_path / "no.csv", half)


def test_tables_and_xml_of_other_things_are_left_to_others(tmp_path: Path) -> None:
    for name, text in (("points.csv", "axis-0,axis-1\n1,2\n"), ("ome.xml", "<OME></OME>")):
        path = tmp_path / name
        path.write_text(text, "utf-8")
        assert get_tracks_reader(str(path)) is None
    assert get_tracks_reader(str(tmp_path / "image.tif")) is None
    assert get_tracks_reader([]) is None


def test_napari_itself_finds_the_reader_and_the_writer(
    tracks: Tracks, tmp_path: Path, make_napari_viewer: Any, npe2pm: Any
) -> None:
    path = write_tracks(tmp_path / "some.geff", tracks)
    with npe2pm.tmp_plugin(manifest=npe2.PluginManifest.from_file(MANIFEST)):
        viewer = make_napari_viewer()
        (layer,) = viewer.open(str(path), plugin="napari-unwrap3d")
        assert type(layer).__name__ == "Tracks"
        assert layer.save(str(tmp_path / "again.csv"), plugin="napari-unwrap3d")
    assert read_tracks(tmp_path / "again.csv").ids.tolist() == [1, 2, 4]
