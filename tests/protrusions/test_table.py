"""What a protrusion measures: against known solids, and the same however it lies or is asked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from napari_unwrap3d.charts import MOTIFS, Floats, Mask, Surface
from napari_unwrap3d.geometry.distance import signed_distance
from napari_unwrap3d.geometry.marching import clamped_marching_cubes
from napari_unwrap3d.geometry.mesh import face_areas
from napari_unwrap3d.parameters import SurfaceParameters
from napari_unwrap3d.progress import silent
from napari_unwrap3d.protrusions.columns import COLUMNS
from napari_unwrap3d.protrusions.segment import Segmentation, measured
from napari_unwrap3d.protrusions.table import measure_protrusions, parts_against_whole, present
from napari_unwrap3d.simulate import cell
from napari_unwrap3d.unwrapping.surface import surface
from synthetic import make_atlas, to_uv

VOXEL = 0.1
BODY, BLEB = 2.2, 1.0
MIDDLE = np.array([3.0, 3.1, 2.95])
UNITS = {"µm": "_um", "µm²": "_um2", "µm³": "_um3", "1/µm": "_per_um", "pixel": "_px"}


@dataclass(frozen=True)
class Known:
    """A ball with a smaller one on it, `apart` from its middle, and what that measures."""

    mask: Mask
    surface: Surface
    found: Segmentation
    axis: Floats
    truth: dict[str, float]

    @property
    def nowhere(self) -> Floats:
        return np.full((len(self.surface.vertices), 3), np.nan)


def ball_on_ball(apart: float, axis: tuple[float, float, float] = (2.0, 1.0, -1.5)) -> Known:
    along = np.array(axis) / np.linalg.norm(axis)
    bleb = MIDDLE + apart * along

    def depth(points: Floats) -> tuple[Floats, Floats]:
        """In the body and in the bleb."""
        from_middle, from_bleb = (np.linalg.norm(points - p, axis=-1) for p in (MIDDLE, bleb))
        return BODY - from_middle, BLEB - from_bleb

    body, over = depth(np.indices((70, 70, 70)).transpose(1, 2, 3, 0) * VOXEL)
    mask = Mask((body > 0) | (over > 0), (VOXEL,) * 3)
    # Of the exact shape, not of its voxels.
    vertices, faces = clamped_marching_cubes(np.maximum(body, over) / VOXEL)
    vertices = vertices * VOXEL
    fields = {"mean_curvature_per_um": vertices[:, 0]}
    at_body, at_bleb = depth(vertices)
    labels = (np.abs(at_bleb) < np.abs(at_body)).astype(np.int32)
    volume = (mask.data & (body <= 0)).astype(np.int32)
    found = Segmentation(labels, -at_body, volume, mask.data & (volume == 0))
    mesh = Surface(vertices, faces, fields)
    # Where the plane of the circle is in which the spheres meet.
    plane = (apart**2 + BODY**2 - BLEB**2) / (2 * apart)
    caps = [
        np.pi * h**2 * (3 * r - h) / 3
        for r, h in ((BODY, BODY - plane), (BLEB, BLEB - (apart - plane)))
    ]
    base = 2 * np.pi * BODY * (BODY - plane)
    truth = {
        "area_um2": 2 * np.pi * BLEB * (BLEB + apart - plane),
        "volume_um3": 4 / 3 * np.pi * BLEB**3 - sum(caps),
        "height_max_um": apart + BLEB - BODY,
        "base_area_um2": base,
        "width_um": 2 * np.sqrt(base / np.pi),
        "neck_um": 2 * np.sqrt(BODY**2 - plane**2),
    }
    return Known(mask, mesh, found, along, truth)


@pytest.fixture(scope="module")
def bleb() -> Known:
    return ball_on_ball(2.75)


def table(known: Known, **options: Any) -> dict[str, npt.NDArray[Any]]:
    return measure_protrusions(known.found, known.mask, known.surface, known.nowhere, **options)


def test_columns_are_all_described_and_carry_their_unit(bleb: Known) -> None:
    columns = table(bleb)
    assert list(columns) == list(COLUMNS)
    for name, column in COLUMNS.items():
        assert column.title
        assert column.meaning.endswith(".")
        assert len(columns[name]) == 1
        if column.unit:
            assert name.endswith(UNITS[column.unit])
        else:
            assert not name.endswith(tuple(UNITS.values()))


@pytest.mark.parametrize("apart", [2.0, 2.75, 2.95])
def test_a_ball_on_a_ball_measures_what_it_is(apart: float) -> None:
    known = ball_on_ball(apart)
    columns = table(known)
    within = {"area_um2": 0.02, "volume_um3": 0.01, "height_max_um": 0.02}
    for name, truth in known.truth.items():
        assert columns[name][0] == pytest.approx(truth, rel=within.get(name, 0.08)), name
    axis = np.array([columns[f"axis_{name}"][0] for name in "zyx"])
    assert axis @ known.axis > np.cos(np.deg2rad(2))
    assert np.linalg.norm(axis) == pytest.approx(1)
    assert columns["base_elongation"][0] == pytest.approx(1, abs=0.1)
    assert columns["aspect"][0] == columns["height_max_um"][0] / columns["width_um"][0]
    assert MOTIFS[columns["motif"][0]] == "bleb"


def test_all_of_a_ball_is_a_ball() -> None:
    """Nearly free of the body: extents, sphericity, solidity and centroid of a ball."""
    known = ball_on_ball(3.17)
    columns = table(known)
    for name in ("length_um", "breadth_um", "thickness_um"):
        assert columns[name][0] == pytest.approx(2 * BLEB, rel=0.02)
    assert columns["sphericity"][0] == pytest.approx(1, abs=0.03)
    assert columns["solidity"][0] == pytest.approx(0.96, abs=0.03)
    assert columns["sheetness"][0] < 0.02
    # The field of the curvature is z here.
    assert columns["mean_curvature_per_um"][0] == columns["z_um"][0]
    highest = known.surface.vertices[known.found.labels > 0, 0].max()
    assert columns["mean_curvature_max_per_um"][0] == highest
    centroid = np.array([columns[f"{name}_um"][0] for name in "zyx"])
    np.testing.assert_allclose(centroid, MIDDLE + 3.17 * known.axis, atol=0.05)


def test_areas_of_all_labels_add_up_to_the_surface(bleb: Known) -> None:
    """Partial faces at borders are shared out: nothing is lost and nothing counted twice."""
    rng = np.random.default_rng(0)
    labels = rng.integers(1, 9, len(bleb.surface.vertices)).astype(np.int32)
    found = Segmentation(labels, bleb.found.height_um, bleb.found.volume, bleb.found.cortex)
    columns = measure_protrusions(found, bleb.mask, bleb.surface, bleb.nowhere)
    total = face_areas(bleb.surface.vertices, bleb.surface.faces).sum()
    assert columns["area_um2"].sum() == pytest.approx(total, rel=1e-12)
    assert columns["vertices"].sum() == len(labels)
    assert (columns["touching"] == 7).all()


def test_numbers_do_not_depend_on_how_the_cell_lies(bleb: Known) -> None:
    """Axes swapped and mirrored on the grid: the same solid, so the same numbers."""
    turned_mask = Mask(bleb.mask.data.transpose(2, 0, 1)[::-1].copy(), (VOXEL,) * 3)
    last = (bleb.mask.shape[2] - 1) * VOXEL
    vertices = bleb.surface.vertices[:, [2, 0, 1]] * [-1, 1, 1] + [last, 0, 0]
    mesh = Surface(vertices, bleb.surface.faces[:, ::-1], bleb.surface.fields)

    def turned(volume: npt.NDArray[Any]) -> npt.NDArray[Any]:
        return volume.transpose(2, 0, 1)[::-1].copy()

    found = Segmentation(
        bleb.found.labels,
        bleb.found.height_um,
        turned(bleb.found.volume),
        turned(bleb.found.cortex),
    )
    one, other = table(bleb), measure_protrusions(found, turned_mask, mesh, bleb.nowhere)
    for name in COLUMNS:
        if name not in ("z_um", "y_um", "x_um", "axis_z", "axis_y", "axis_x", "v_px", "u_px"):
            np.testing.assert_allclose(one[name], other[name], rtol=1e-6, err_msg=name)


def several() -> Known:
    """Simulated blebs as they truly are."""
    truth = cell("blebs", 10, size=96).truth
    mesh = surface(truth.mask, SurfaceParameters(), None, silent())
    labels = of_vertices(mesh, truth.mask, truth.labels.data)
    voxel = truth.mask.voxel_size[0]
    places = tuple(np.rint(truth.mask.to_index(mesh.vertices)).astype(int).T)
    height = signed_distance(truth.body.data)[places].astype(float) * voxel
    volume = truth.labels.data.astype(np.int32)
    found = Segmentation(labels, height, volume, truth.mask.data & (volume == 0))
    return Known(truth.mask, mesh, found, np.zeros(3), {})


def of_vertices(mesh: Surface, mask: Mask, labels: npt.NDArray[Any]) -> npt.NDArray[np.int32]:
    """The label of the voxel just below every vertex."""
    from napari_unwrap3d.geometry.mesh import vertex_normals

    normals = vertex_normals(mesh.vertices, mesh.faces)
    below = mask.to_index(mesh.vertices) - 0.7 * normals
    return labels[tuple(np.rint(below).astype(int).T)].astype(np.int32)


def test_some_labels_measure_the_same_bit_for_bit_as_all() -> None:
    known = several()
    everything = table(known)
    rng = np.random.default_rng(1)
    for _ in range(3):
        some = rng.choice(everything["label"], 4, replace=False)
        again = table(known, only=some)
        rows = np.isin(everything["label"], some)
        for name, column in everything.items():
            assert again[name].dtype == column.dtype
            assert again[name].tobytes() == column[rows].tobytes(), name
    assert len(table(known, only=[])["label"]) == 0


@pytest.mark.parametrize(
    ("kind", "size"), [("blebs", 96), ("lamellipodia", 112), ("filopodia", 112)]
)
def test_motifs_are_told_apart_by_their_shape(kind: str, size: int) -> None:
    truth = cell(kind, 12, size=size).truth
    mesh = surface(truth.mask, SurfaceParameters(), None, silent())
    volume = truth.labels.data.astype(np.int32)
    labels = of_vertices(mesh, truth.mask, truth.labels.data)
    cortex = truth.mask.data & (volume == 0)
    found = Segmentation(labels, np.zeros(len(labels)), volume, cortex)
    columns = measure_protrusions(found, truth.mask, mesh, np.full((len(labels), 3), np.nan))
    guessed = np.array(MOTIFS)[columns["motif"]]
    right = guessed == np.array(truth.kinds)[columns["label"] - 1]
    assert right.mean() >= 0.9


def test_the_place_in_uv_is_the_same_over_the_seam_and_the_pole() -> None:
    atlas = make_atlas()
    rows = 40
    directions = atlas.surface.vertices - 6.0
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    image = np.column_stack([np.zeros(len(directions)), to_uv(directions, rows)])
    image[::7] = np.nan  # some have no image
    for axis in ([1.0, 0.02, 0.0], [0.0, 0.0, -1.0], [0.3, 0.5, 0.2]):
        middle = np.array(axis) / np.linalg.norm(axis)
        labels = (directions @ middle > 0.85).astype(np.int32)
        nothing = np.zeros(atlas.mask.shape, np.int32)
        found = Segmentation(labels, np.ones(len(labels)), nothing, atlas.mask.data)
        columns = measure_protrusions(found, atlas.mask, atlas.surface, image, rows=rows)
        v, u = to_uv(middle[None], rows)[0]
        assert abs(columns["v_px"][0] - v) < 1
        # A pixel at a pole is narrow.
        apart = (columns["u_px"][0] - u + rows) % (2 * rows) - rows
        assert abs(apart) * np.sin((v + 0.5) * np.pi / rows) < 1


def test_edge_cases_have_a_table() -> None:
    known = ball_on_ball(2.75)
    count = len(known.surface.vertices)
    nothing = np.zeros(known.mask.shape, np.int32)

    def found(labels: npt.NDArray[Any], volume: npt.NDArray[Any]) -> Segmentation:
        cortex = known.mask.data & (volume == 0)
        height = known.found.height_um
        return Segmentation(labels.astype(np.int32), height, volume.astype(np.int32), cortex)

    none = measured(found(np.zeros(count), nothing), known.mask, known.surface, known.nowhere, "")
    assert none.count == 0
    assert list(none.table.columns) == list(COLUMNS)
    assert none.numbers["parts_difference"] == 0

    single = np.zeros(count)
    single[5] = 7
    alone = measured(found(single, nothing), known.mask, known.surface, known.nowhere, "")
    assert alone.columns["label"].tolist() == [7]
    assert alone.columns["vertices"].tolist() == [1]
    assert alone.columns["volume_um3"][0] == alone.columns["width_um"][0] == 0
    assert np.isnan([alone.columns[name][0] for name in ("aspect", "solidity", "axis_x")]).all()

    half = known.surface.vertices[:, 0] > MIDDLE[0]
    upper = known.mask.data & (np.arange(70)[:, None, None] * VOXEL > MIDDLE[0])
    row = measure_protrusions(found(half, upper), known.mask, known.surface, known.nowhere)
    assert row["base_area_um2"][0] == pytest.approx(np.pi * BODY**2, rel=0.05)
    assert row["axis_z"][0] > 0.95

    voxel = nothing.copy()
    voxel[tuple(np.argwhere(known.mask.data)[0])] = 3
    lone = measure_protrusions(
        found(np.zeros(count), voxel), known.mask, known.surface, known.nowhere
    )
    assert lone["label"].tolist() == [3]
    assert lone["volume_um3"][0] == pytest.approx(VOXEL**3)
    assert lone["vertices"][0] == 0


def test_cortex_and_protrusions_are_the_cell(bleb: Known) -> None:
    numbers = parts_against_whole(bleb.found, bleb.mask)
    assert numbers["parts_difference"] == 0
    assert numbers["protrusions_um3"] == pytest.approx(table(bleb)["volume_um3"].sum())
    lost = bleb.found.cortex.copy()
    lost[tuple(np.argwhere(lost)[0])] = False
    gap = Segmentation(bleb.found.labels, bleb.found.height_um, bleb.found.volume, lost)
    assert parts_against_whole(gap, bleb.mask)["parts_difference"] < 0
    assert present(bleb.found).tolist() == [1]
