"""Scalars and labels carried between charts."""

import numpy as np
import pytest

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.charts import Mask, Volume
from napari_unwrap3d.errors import AxesError, Cancelled, ChartMissingError, ParameterError
from napari_unwrap3d.pipeline import Pipeline
from napari_unwrap3d.progress import Progress
from napari_unwrap3d.unwrapping.uv import pixel_grid, uv_to_direction
from shapes import QUICK, VOXEL_UM, cell_centre

CHARTS = ("surface", "reference", "sphere", "uv", "topography", "volume")


def shape_of(atlas: Atlas, chart: str) -> tuple[int, ...]:
    if chart in ("surface", "reference", "sphere"):
        return (len(getattr(atlas, chart).vertices),)
    if chart == "volume":
        return atlas.mask.shape
    return getattr(atlas, chart).shape


def constant(atlas: Atlas, chart: str, value: float, dtype: type):
    values = np.full(shape_of(atlas, chart), value, dtype)
    if chart == "volume":
        return Volume(values, atlas.mask.voxel_size, atlas.mask.origin)
    return values


def array(carried) -> np.ndarray:
    return carried.data if isinstance(carried, Volume) else carried


def coarse(atlas: Atlas) -> Atlas:
    """The atlas with a volume of an eighth of the voxels, for maps of every voxel."""
    mask = Mask(atlas.mask.data[::2, ::2, ::2], (2 * VOXEL_UM,) * 3, atlas.mask.origin)
    return atlas.replaced(mask=mask)


@pytest.mark.parametrize("source", CHARTS)
@pytest.mark.parametrize("target", CHARTS)
def test_constants_stay_constant(small_atlas: Atlas, source: str, target: str) -> None:
    atlas = coarse(small_atlas) if target == "volume" else small_atlas
    kinds = ["label"] if target == "volume" else ["scalar", "label"]  # once is enough
    for kind in kinds:
        value, dtype = (2.5, float) if kind == "scalar" else (7, np.uint16)
        carried = array(atlas.carry(constant(atlas, source, value, dtype), source, target, kind))
        assert carried.shape == shape_of(atlas, target)
        if kind == "scalar":
            known = np.isfinite(carried)
            np.testing.assert_allclose(carried[known], 2.5, rtol=1e-6)
        else:
            known = carried == 7
            assert carried.dtype == np.uint16
            assert (carried[~known] == 0).all()
        assert known.any()
        if not {"topography", "volume"} & {source, target}:
            assert known.all()


def smooth(where: np.ndarray) -> np.ndarray:
    z, y, x = np.moveaxis(where, -1, 0)
    return z - 0.5 * y + 0.8 * x * y


def sphere_image(atlas: Atlas) -> np.ndarray:
    """A smooth function of direction as a uv image."""
    rows = atlas.uv.shape[0]
    where = uv_to_direction(pixel_grid(rows).reshape(-1, 2), rows)
    return smooth(where).reshape(rows, 2 * rows)


def test_a_smooth_image_survives_the_way_over_the_reference(small_atlas: Atlas) -> None:
    image = sphere_image(small_atlas)
    on_reference = small_atlas.carry(image, "uv", "reference")
    back = small_atlas.carry(on_reference, "reference", "uv")
    expected = smooth(small_atlas.sphere.vertices @ small_atlas.uv.rotation.T)
    assert np.abs(on_reference - expected).max() < 0.01
    assert np.abs(back - image).max() < 0.02


REGIONS = {
    "seam": lambda v, u, n: (np.abs(v - n / 2) < n / 5) & ((u < n / 4) | (u > 2 * n - n / 4)),
    "north pole": lambda v, u, n: v < n / 4,
    "south pole": lambda v, u, n: (v > n - n / 4) & (np.sin(u * np.pi / n) > -0.9),
    "middle": lambda v, u, n: (v - n / 2) ** 2 + (u - n) ** 2 < (n / 4) ** 2,
}


@pytest.mark.parametrize("region", REGIONS)
def test_labels_over_seam_and_poles_come_back(small_atlas: Atlas, region: str) -> None:
    rows = small_atlas.uv.shape[0]
    v, u = np.mgrid[:rows, : 2 * rows]
    labels = np.where(REGIONS[region](v, u, rows), 3, 0).astype(np.int32)
    on_reference = small_atlas.carry(labels, "uv", "reference", kind="label")
    back = small_atlas.carry(on_reference, "reference", "uv", kind="label")
    assert set(np.unique(on_reference)) == {0, 3}
    weight = small_atlas.uv.fields["area_um2"]
    both = weight[(labels == 3) & (back == 3)].sum()
    either = weight[(labels == 3) | (back == 3)].sum()
    assert both / either > 0.97  # of a coarse image: the border is a pixel wide


def test_labels_drawn_on_the_image_mark_the_whole_column_of_the_surface(
    small_atlas: Atlas,
) -> None:
    rows = small_atlas.uv.shape[0]
    labels = np.zeros((rows, 2 * rows), np.uint8)
    labels[20:40, 30:60] = 5
    marked = small_atlas.carry(labels, "uv", "surface", kind="label")
    where = small_atlas.topography.surface[:, 1:]
    inside = (where[:, 0] > 20) & (where[:, 0] < 39) & (where[:, 1] > 30) & (where[:, 1] < 59)
    outside = (where[:, 0] < 19) | (where[:, 0] > 40) | (where[:, 1] < 29) | (where[:, 1] > 60)
    assert inside.any()
    assert (marked[inside] == 5).all()
    assert (marked[outside] == 0).all()


def linear_volume(atlas: Atlas) -> tuple[Volume, np.ndarray]:
    slope = np.array([2.0, -1.0, 0.5])
    index = np.stack(np.indices(atlas.mask.shape), axis=-1)
    values = (atlas.mask.to_world(index) - cell_centre()) @ slope
    return Volume(values, atlas.mask.voxel_size, atlas.mask.origin), slope


def test_a_linear_volume_is_exact_in_the_topography_and_on_every_surface(
    small_atlas: Atlas,
) -> None:
    volume, slope = linear_volume(small_atlas)
    for chart, positions in (
        ("topography", small_atlas.topography.positions),
        ("surface", small_atlas.surface.vertices),
        ("reference", small_atlas.reference.vertices),
        ("uv", small_atlas.uv.positions),
    ):
        found = small_atlas.carry(volume, "volume", chart)
        expected = (positions.astype(float) - cell_centre()) @ slope
        index = volume.to_index(positions)
        inside = ((index >= 0) & (index <= np.array(volume.shape) - 1)).all(axis=-1)
        assert inside.mean() > 0.9
        assert np.isfinite(found[inside]).all()
        np.testing.assert_allclose(found[inside], expected[inside], atol=1e-4)


def test_a_volume_survives_the_way_over_the_topography(small_atlas: Atlas) -> None:
    volume, _ = linear_volume(small_atlas)
    topographic = small_atlas.carry(volume, "volume", "topography")
    atlas = coarse(small_atlas)
    back = atlas.carry(topographic, "topography", "volume")
    assert isinstance(back, Volume)
    assert back.voxel_size == atlas.mask.voxel_size
    assert back.origin == atlas.mask.origin
    known = np.isfinite(back.data)
    shell = np.linalg.norm(
        back.to_world(np.stack(np.indices(back.shape), axis=-1)) - cell_centre(),
        axis=-1,
    )
    assert known[(shell > 1.2) & (shell < 1.9)].mean() > 0.99
    assert not known[shell > 6].any()
    error = np.abs(back.data - volume.data[::2, ::2, ::2])[known]
    assert np.median(error) < 0.01
    assert np.quantile(error, 0.99) < 0.06


def test_the_mapped_mask_is_the_carried_mask(small_atlas: Atlas) -> None:
    carried = small_atlas.carry(small_atlas.mask, "volume", "topography", kind="label")
    assert (carried == small_atlas.topography.mask).mean() > 0.97


def test_outside_of_the_volume_there_is_no_value(small_atlas: Atlas) -> None:
    """A volume that holds only half of the cell says nothing about the other half."""
    half = small_atlas.mask.data[: small_atlas.mask.shape[0] // 2]
    volume = Volume(np.ones(half.shape), small_atlas.mask.voxel_size, small_atlas.mask.origin)
    labels = Volume(volume.data.astype(np.uint8), volume.voxel_size, volume.origin)
    edge = volume.to_world([[half.shape[0], 0, 0]])[0, 0]
    for chart, positions in (
        ("surface", small_atlas.surface.vertices),
        ("uv", small_atlas.uv.positions),
        ("topography", small_atlas.topography.positions),
    ):
        outside = positions[..., 0] > edge
        scalar = small_atlas.carry(volume, "volume", chart)
        label = small_atlas.carry(labels, "volume", chart, kind="label")
        assert np.isnan(scalar[outside]).all()
        assert (label[outside] == 0).all()
        assert (label[positions[..., 0] < edge - 2 * VOXEL_UM] == 1).mean() > 0.95


def test_the_outermost_sheet_is_seen_from_the_image(small_atlas: Atlas) -> None:
    height = small_atlas.surface.fields["height_um"]
    image = small_atlas.carry(height, "surface", "uv")
    np.testing.assert_allclose(image, small_atlas.topography.fields["height_um"], atol=1e-9)
    labels = (height > 0.5).astype(int)
    seen = small_atlas.carry(labels, "surface", "uv", kind="label")
    clear = np.abs(image - 0.5) > 0.15
    np.testing.assert_array_equal(seen[clear], (image > 0.5)[clear].astype(int))


def test_labels_of_the_surface_lie_along_it_in_the_topography(small_atlas: Atlas) -> None:
    ones = np.ones(len(small_atlas.surface.vertices), int)
    carried = small_atlas.carry(ones, "surface", "topography", kind="label")
    mask = small_atlas.topography.mask
    crossing = mask[:-1] & ~mask[1:]
    assert (carried[:-1][crossing] == 1).all()
    assert carried.mean() < 0.3


def test_reference_and_sphere_share_their_values(small_atlas: Atlas) -> None:
    values = np.random.default_rng(0).normal(size=len(small_atlas.reference.vertices))
    np.testing.assert_array_equal(small_atlas.carry(values, "reference", "sphere"), values)
    np.testing.assert_array_equal(small_atlas.carry(values, "sphere", "reference"), values)


def test_scalars_are_pulled_back_from_the_reference_to_the_surface(small_atlas: Atlas) -> None:
    z = small_atlas.reference.vertices[:, 0]
    on_surface = small_atlas.carry(z, "reference", "surface")
    mapped, valid = small_atlas.map(small_atlas.surface.vertices, "surface", "reference")
    np.testing.assert_array_equal(np.isfinite(on_surface), valid)
    assert np.abs(on_surface - mapped[:, 0])[valid].max() < 0.05


@pytest.mark.parametrize("chart", ["surface", "reference", "uv", "topography"])
def test_values_of_the_wrong_size_are_an_error(small_atlas: Atlas, chart: str) -> None:
    for wrong in (np.zeros(3), np.zeros((*shape_of(small_atlas, chart), 3))):
        with pytest.raises(AxesError, match=f"Values of {chart}") as caught:
            small_atlas.carry(wrong, chart, "sphere")
        assert caught.value.measured["shape"] == wrong.shape


def test_labels_are_integers(small_atlas: Atlas) -> None:
    with pytest.raises(AxesError, match="float64"):
        small_atlas.carry(np.zeros(small_atlas.uv.shape), "uv", "surface", kind="label")


def test_there_are_two_kinds_of_values(small_atlas: Atlas) -> None:
    with pytest.raises(ParameterError, match="'labels'"):
        small_atlas.carry(np.zeros(small_atlas.uv.shape, int), "uv", "surface", kind="labels")


def test_a_volume_knows_its_place(small_atlas: Atlas) -> None:
    with pytest.raises(AxesError, match="Volume"):
        small_atlas.carry(np.zeros(small_atlas.mask.shape), "volume", "surface")


def test_unknown_and_missing_charts(small_atlas: Atlas, small_pipeline: Pipeline) -> None:
    image = np.zeros(small_atlas.uv.shape)
    with pytest.raises(ChartMissingError):
        small_atlas.carry(image, "plan", "uv")
    with pytest.raises(ChartMissingError):
        small_atlas.carry(image, "uv", "plan")
    part = small_pipeline.run(QUICK, until="uv")
    with pytest.raises(ChartMissingError, match="topography"):
        part.carry(image, "uv", "surface")


def test_carrying_reports_and_can_be_cancelled(small_atlas: Atlas) -> None:
    image = np.zeros(small_atlas.uv.shape)
    seen: list[float] = []
    small_atlas.carry(
        image, "uv", "surface", progress=Progress(lambda s, fraction, m: seen.append(fraction))
    )
    assert seen == sorted(seen)
    progress = Progress()
    progress.cancel()
    with pytest.raises(Cancelled):
        small_atlas.carry(image, "uv", "surface", progress=progress)


@pytest.mark.parametrize("other", CHARTS)
def test_constants_stay_constant_to_and_from_the_plane(plane_atlas: Atlas, other: str) -> None:
    atlas = coarse(plane_atlas) if other == "volume" else plane_atlas
    for source, target in ((other, "plane"), ("plane", other)):
        for kind, value, dtype in (("scalar", 2.5, float), ("label", 7, np.uint16)):
            values = constant(atlas, source, value, dtype)
            carried = array(atlas.carry(values, source, target, kind))
            assert carried.shape == shape_of(atlas, target)
            known = np.isfinite(carried) & (carried != 0)
            np.testing.assert_allclose(carried[known], value, rtol=1e-6)
            assert known.any()
            if not {"topography", "volume"} & {source, target}:
                assert known.all()


def test_labels_of_every_sheet_come_back_from_the_plane(plane_atlas: Atlas) -> None:
    """Also below an overhang, which the uv image does not show."""
    place = plane_atlas.surface.vertices
    labels = 1 + (place[:, 2] > np.median(place[:, 2])) + 2 * (place[:, 1] > np.median(place[:, 1]))
    image = plane_atlas.carry(labels, "surface", "plane", kind="label")
    assert image.shape == plane_atlas.plane.shape
    assert set(np.unique(image)) == {1, 2, 3, 4}
    back = plane_atlas.carry(image, "plane", "surface", kind="label")
    assert (back == labels).mean() > 0.97


def test_scalars_of_the_surface_are_read_at_the_pixels_places(plane_atlas: Atlas) -> None:
    place = plane_atlas.surface.vertices
    image = plane_atlas.carry(place[:, 0], "surface", "plane")
    np.testing.assert_allclose(image, plane_atlas.plane.positions[..., 0], atol=1e-6)


def test_values_of_the_plane_have_its_size(plane_atlas: Atlas) -> None:
    with pytest.raises(AxesError, match="plane"):
        plane_atlas.carry(np.zeros((4, 8)), "plane", "surface")
