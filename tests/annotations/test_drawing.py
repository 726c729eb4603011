"""What is drawn on one chart is on all of them, and comes back as it was drawn."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from napari_unwrap3d.annotations import Annotations
from napari_unwrap3d.annotations.charts import sealed_maps
from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.charts import Ints
from napari_unwrap3d.errors import AxesError, ChartMissingError, ParameterError
from napari_unwrap3d.unwrapping.direct import labels_of_owners
from shapes import BUMPS, VOXEL_UM, cell_centre
from synthetic import make_atlas

CHARTS = ("surface", "uv", "direct", "plane", "topography", "volume", "reference", "sphere")


@pytest.fixture(scope="module")
def round_atlas() -> Atlas:
    return make_atlas()


def fresh(atlas: Atlas) -> Annotations:
    annotations = Annotations(atlas)
    annotations.add("one")
    return annotations


def disc(rows: int, v: int, u: int, radius: int) -> np.ndarray:
    """Pixels (N, 2N) around a place, continued over the seam and the poles."""
    inside = np.zeros((rows, 2 * rows), bool)
    for i in range(v - radius, v + radius + 1):
        for j in range(u - radius, u + radius + 1):
            if (i - v) ** 2 + (j - u) ** 2 <= radius**2:
                over = i < 0 or i >= rows
                row = -1 - i if i < 0 else 2 * rows - 1 - i if i >= rows else i
                inside[row, (j + rows * over) % (2 * rows)] = True
    return inside


def column(atlas: Atlas, drawn: np.ndarray) -> Ints:
    """The vertices whose (v, u) lies in drawn pixels, one by one."""
    rows = len(drawn)
    found = []
    for vertex, (_, v, u) in enumerate(atlas.topography.surface):
        if np.isfinite(v):
            row, col = int(np.floor(v + 0.5)), int(np.floor(u + 0.5)) % (2 * rows)
            if drawn[min(max(row, 0), rows - 1), col]:
                found.append(vertex)
    return np.array(found, np.int64)


def places(rows: int) -> st.SearchStrategy[tuple[int, int, int]]:
    """Everywhere, and more often at the seam and the poles."""
    v = st.one_of(st.integers(0, rows - 1), st.sampled_from([0, 1, rows - 2, rows - 1]))
    u = st.one_of(st.integers(0, 2 * rows - 1), st.sampled_from([0, 1, 2 * rows - 1]))
    return st.tuples(v, u, st.integers(0, rows // 5))


# uv ------------------------------------------------------------------------------


@given(place=places(32))
def test_drawing_in_uv_marks_exactly_the_column(
    round_atlas: Atlas, place: tuple[int, int, int]
) -> None:
    annotations, drawn = fresh(round_atlas), disc(32, *place)
    annotations.draw("one", "uv", np.nonzero(drawn), 3)
    marked = np.flatnonzero(annotations.labels("one") == 3)
    assert marked.tolist() == column(round_atlas, drawn).tolist()
    assert (annotations.image("one", "uv") == 3 * drawn).all()


@settings(max_examples=25)
@given(place=places(64), data=st.data())
def test_uv_gives_back_what_was_drawn_also_under_overhangs(
    small_atlas: Atlas, place: tuple[int, int, int], data: st.DataObject
) -> None:
    annotations, expected = fresh(small_atlas), np.zeros((64, 128), np.uint16)
    everywhere = [place, *data.draw(st.lists(places(64), max_size=3))]
    for number, where in enumerate(everywhere):
        label = number % 3  # 0 erases
        drawn = disc(64, *where)
        annotations.draw("one", "uv", np.nonzero(drawn), label)
        expected[drawn] = label
        assert (annotations.labels("one")[column(small_atlas, drawn)] == label).all()
    assert (annotations.image("one", "uv") == expected).all()


def test_over_both_poles_and_the_seam_no_vertex_is_missed(small_atlas: Atlas) -> None:
    for v, u in ((0, 5), (63, 90), (30, 0), (30, 127)):
        annotations, drawn = fresh(small_atlas), disc(64, v, u, 9)
        annotations.draw("one", "uv", np.nonzero(drawn), 1)
        expected = column(small_atlas, drawn)
        assert len(expected) > 20
        assert np.flatnonzero(annotations.labels("one")).tolist() == expected.tolist()


def test_a_column_has_two_sheets_and_the_outermost_is_one_of_them(small_atlas: Atlas) -> None:
    """Under the top of the mushroom's cap lies its underside."""
    axis = np.array(BUMPS[-1][0]) / np.linalg.norm(BUMPS[-1][0])
    cap = cell_centre() + VOXEL_UM * BUMPS[-1][1] * axis
    vertices = small_atlas.surface.vertices
    image = small_atlas.topography.surface
    over_cap = np.linalg.norm(vertices - cap, axis=1) < 0.8
    drawn = np.zeros((64, 128), bool)
    pixel = np.floor(image[over_cap & np.isfinite(image[:, 0]), 1:] + 0.5).astype(int)
    drawn[pixel[:, 0], pixel[:, 1] % 128] = True
    annotations = fresh(small_atlas)
    annotations.draw("one", "uv", np.nonzero(drawn), 1)
    column_marked = annotations.labels("one") == 1
    annotations.add("two")
    annotations.overhang = "outermost"
    annotations.draw("two", "uv", np.nonzero(drawn), 1)
    outermost_marked = annotations.labels("two") == 1
    assert not (outermost_marked & ~column_marked).any()
    assert np.count_nonzero(column_marked) > np.count_nonzero(outermost_marked) > 20
    along = (vertices - cap) @ axis
    assert column_marked[over_cap].all()
    assert outermost_marked[over_cap & (along > 0)].all()
    assert not outermost_marked[over_cap & (along < -0.5)].any()
    assert (annotations.image("two", "uv") == drawn).all()


def test_outermost_vertices_have_nothing_over_them(small_atlas: Atlas) -> None:
    """Where the outermost crossing over a vertex is found, it is no other sheet."""
    outermost = Annotations(small_atlas).tables.outermost
    image = small_atlas.topography.surface
    points, valid = small_atlas.map(image[:, 1:], "uv", "surface")
    crossing, inside = small_atlas.map(points[valid], "surface", "topography")
    over = crossing[:, 0] - image[valid, 0]
    hidden = inside & (over > small_atlas.voxel_um)
    assert np.count_nonzero(hidden) > 100
    assert np.mean(outermost[valid][hidden]) < 0.01
    assert np.mean(outermost[valid][inside & (np.abs(over) < 0.1 * small_atlas.voxel_um)]) > 0.99


def test_uv_keeps_its_pixels_until_what_lies_over_them_is_drawn(round_atlas: Atlas) -> None:
    annotations, drawn = fresh(round_atlas), disc(32, 10, 20, 6)
    annotations.draw("one", "uv", np.nonzero(drawn), 2)
    far = np.flatnonzero(annotations.labels("one") == 0)[:5]
    owned = annotations.owners("uv").owned(far)
    annotations.draw_vertices("one", far, 5)
    expected = 2 * drawn.astype(np.uint16)
    expected.ravel()[owned] = 5
    assert (annotations.image("one", "uv") == expected).all()
    annotations.draw_vertices("one", np.arange(len(round_atlas.surface.vertices)), 0)
    assert not annotations.image("one", "uv").any()


# Other charts --------------------------------------------------------------------


@pytest.mark.parametrize("chart", ["direct", "plane", "topography", "volume", "reference"])
def test_drawing_shows_where_it_was_drawn(round_atlas: Atlas, chart: str) -> None:
    annotations = fresh(round_atlas)
    every = np.flatnonzero(annotations.image("one", chart).ravel() == 0)
    shown = np.flatnonzero(everything(annotations, chart))
    assert len(shown) > 0.9 * len(every) or chart in ("topography", "volume")
    for pixels in np.array_split(shown, 5):
        annotations.draw("one", chart, np.unravel_index(pixels, annotations.shape(chart)), 4)
        assert (annotations.image("one", chart).ravel()[pixels] == 4).all()
        annotations.draw("one", chart, np.unravel_index(pixels, annotations.shape(chart)), 0)
        assert (annotations.image("one", chart).ravel()[pixels] == 0).all()
        assert not annotations.labels("one").any()


def everything(annotations: Annotations, chart: str) -> np.ndarray:
    """Which pixels show any vertex."""
    other = fresh(annotations.atlas)
    other.draw_vertices("one", np.arange(len(annotations.atlas.surface.vertices)), 1)
    return other.image("one", chart).ravel() == 1


@pytest.mark.parametrize("chart", ["direct", "plane", "topography", "volume"])
def test_every_vertex_can_be_drawn(plane_atlas: Atlas, chart: str) -> None:
    """Drawing over the whole of a chart leaves none out that it holds."""
    annotations = fresh(plane_atlas)
    annotations.draw("one", chart, np.nonzero(np.ones(annotations.shape(chart), bool)), 1)
    missed = np.flatnonzero(annotations.labels("one") == 0)
    if chart == "topography":
        d, v, u = plane_atlas.topography.surface[missed].T
        inside = (d > plane_atlas.topography.d_um[0]) & (d < plane_atlas.topography.d_um[-1])
        assert not (inside & np.isfinite(v + u)).any()
    else:
        assert len(missed) == 0


@pytest.mark.parametrize("chart", ["topography", "volume"])
def test_nodes_mark_the_vertices_nearest_to_them_and_in_them(
    small_atlas: Atlas, chart: str
) -> None:
    annotations = fresh(small_atlas)
    whole = annotations.shape(chart)
    nodes = small_atlas.mask.to_world(np.indices(whole).reshape(3, -1).T)
    if chart == "topography":
        nodes = small_atlas.topography.positions.reshape(-1, 3).astype(float)
    vertices, voxel = small_atlas.surface.vertices, small_atlas.voxel_um
    rng = np.random.default_rng(0)
    for vertex in rng.choice(len(vertices), 20, replace=False):
        near = np.flatnonzero(np.linalg.norm(nodes - vertices[vertex], axis=1) < 2 * voxel)
        annotations.draw("one", chart, np.unravel_index(near, whole), 1)
        marked = np.flatnonzero(annotations.labels("one"))
        assert vertex in marked
        apart = np.linalg.norm(vertices[marked][:, None] - nodes[near], axis=2).min(axis=1)
        assert apart.max() < 2.5 * voxel
        annotations.undo()


@settings(max_examples=20)
@given(seed=st.integers(0, 10**6), radius=st.floats(0.2, 1.5))
def test_from_the_surface_to_the_direct_chart_and_back(
    small_atlas: Atlas, seed: int, radius: float
) -> None:
    vertices = small_atlas.surface.vertices
    middle = vertices[np.random.default_rng(seed).integers(len(vertices))]
    truth = np.linalg.norm(vertices - middle, axis=1) < radius
    annotations = fresh(small_atlas)
    annotations.draw_vertices("one", np.flatnonzero(truth), 1)
    read = labels_of_owners(small_atlas.direct, annotations.image("one", "direct")) == 1
    speaks = small_atlas.direct.spokesman == np.arange(len(vertices))
    assert (read[speaks] == truth[speaks]).all()
    if speaks.all():
        assert (read == truth).all()


def test_the_direct_chart_never_mixes_two_sheets(small_atlas: Atlas) -> None:
    """Drawing where a patch is seen marks it, and nothing farther than an edge or two."""
    annotations, vertices = fresh(small_atlas), small_atlas.surface.vertices
    cap = np.linalg.norm(vertices - cell_centre(), axis=1) > 2.2
    owners = annotations.owners("direct")
    pixels = owners.owned(np.flatnonzero(cap))
    annotations.draw("one", "direct", np.unravel_index(pixels, owners.shape), 1)
    marked = annotations.labels("one") == 1
    reach = cap.copy()
    for _ in range(2):
        reach[small_atlas.surface.faces[reach[small_atlas.surface.faces].any(axis=1)]] = True
    assert not (marked & ~reach).any()
    assert np.mean(marked[cap]) > 0.95


def test_a_stroke_on_the_surface_over_the_seam_is_in_both_parts(round_atlas: Atlas) -> None:
    annotations = fresh(round_atlas)
    _, v, u = round_atlas.topography.surface.T
    stroke = np.flatnonzero((np.abs(v - 15) < 4) & ((u < 6) | (u > 57)))
    annotations.draw_vertices("one", stroke, 1)
    image = annotations.image("one", "uv")
    assert image[:, :6].any()
    assert image[:, 58:].any()
    assert set(annotations.owners("uv")._shown[np.flatnonzero(image)]) <= set(stroke)
    assert (annotations.image("one", "direct")[:, :6]).any()
    assert (annotations.image("one", "direct")[:, 58:]).any()


def test_what_only_the_sealed_surface_has_shows_nothing(handle_atlas: Atlas) -> None:
    """A wall of the cut through a handle belongs to no vertex of the surface."""
    annotations = fresh(handle_atlas)
    to_surface, to_sealed = sealed_maps(handle_atlas)
    assert (to_surface < 0).any()
    annotations.draw_vertices("one", np.arange(len(handle_atlas.surface.vertices)), 1)
    image = annotations.image("one", "direct")
    assert (image == (to_surface[handle_atlas.direct.owner] >= 0)).all()
    known = to_sealed[to_sealed >= 0]
    apart = handle_atlas.surface.vertices[to_sealed >= 0] - handle_atlas.sealed.vertices[known]
    assert np.linalg.norm(apart, axis=1).max() < 2 * handle_atlas.voxel_um


# Input ---------------------------------------------------------------------------


def test_a_label_for_every_pixel(round_atlas: Atlas) -> None:
    one, other = fresh(round_atlas), fresh(round_atlas)
    indices = np.nonzero(disc(32, 20, 30, 7))
    labels = indices[1] % 3
    one.draw("one", "uv", indices, labels)
    for label in range(3):
        chosen = tuple(axis[labels == label] for axis in indices)
        other.draw("one", "uv", chosen, label)
    assert (one.image("one", "uv") == other.image("one", "uv")).all()
    assert (one.labels("one") == other.labels("one")).all()
    one.undo()
    assert not one.labels("one").any()


def test_what_cannot_be_drawn_is_said(round_atlas: Atlas) -> None:
    annotations = fresh(round_atlas)
    with pytest.raises(AxesError, match="outside"):
        annotations.draw("one", "uv", ([32], [0]), 1)
    with pytest.raises(AxesError, match="outside"):
        annotations.draw("one", "uv", ([-1], [0]), 1)
    with pytest.raises(AxesError, match="per axis"):
        annotations.draw("one", "uv", ([1],), 1)
    with pytest.raises(AxesError, match="per axis"):
        annotations.draw("one", "uv", ([1.0], [1.0]), 1)
    for label in (-1, 65536, 1.5):
        with pytest.raises(ParameterError, match="label"):
            annotations.draw("one", "uv", ([1], [1]), label)
    with pytest.raises(ParameterError, match="no annotation 'two'"):
        annotations.draw("two", "uv", ([1], [1]), 1)
    with pytest.raises(ChartMissingError, match="'moon'"):
        annotations.image("one", "moon")
    with pytest.raises(ParameterError, match="column or outermost"):
        annotations.overhang = "all"  # type: ignore[assignment]
    with pytest.raises(ValueError, match="read-only"):
        annotations.labels("one")[0] = 1
    assert not annotations.labels("one").any()


@pytest.mark.parametrize("name", ["", "  ", "x" * 101, "one"])
def test_names_are_given_once(round_atlas: Atlas, name: str) -> None:
    with pytest.raises(ParameterError, match=r"name|already"):
        fresh(round_atlas).add(name)
