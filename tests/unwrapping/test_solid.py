"""From a mesh to its voxels."""

import numpy as np
import pytest

from napari_unwrap3d.charts import Surface
from napari_unwrap3d.errors import NotWatertightError, SeveralCellsError
from napari_unwrap3d.geometry.mesh import is_watertight, signed_volume
from napari_unwrap3d.unwrapping.solid import closed_mesh, mask_of_mesh
from shapes import icosphere, lumpy, torus_mesh


def body() -> Surface:
    vertices, faces = lumpy(3)
    return Surface(4 * vertices + [100, -50, 7], faces)


@pytest.mark.parametrize("edge", [0.1, 0.25])
def test_the_voxels_have_the_volume_of_the_mesh_and_its_place(edge: float) -> None:
    mesh = body()
    mask, report = mask_of_mesh(mesh, edge)
    assert mask.voxel_size == (edge,) * 3
    volume = mask.data.sum() * edge**3
    assert volume == pytest.approx(signed_volume(mesh.vertices, mesh.faces), rel=0.02)
    inside = mask.to_world(np.argwhere(mask.data))
    np.testing.assert_allclose(inside.min(axis=0), mesh.vertices.min(axis=0), atol=1.5 * edge)
    np.testing.assert_allclose(inside.max(axis=0), mesh.vertices.max(axis=0), atol=1.5 * edge)
    assert report == {
        "working_voxel_um": edge,
        "working_voxel_automatic": False,
        "voxels": mask.data.sum(),
    }


def test_the_voxel_is_chosen_by_the_longest_edge_of_the_box() -> None:
    mesh = body()
    mask, report = mask_of_mesh(mesh, None)
    longest = np.ptp(mesh.vertices, axis=0).max()
    assert mask.voxel_size[0] == pytest.approx(longest / 200)
    assert report["working_voxel_automatic"] is True
    assert np.ptp(np.argwhere(mask.data), axis=0).max() in (198, 199, 200)


def test_there_is_room_around_the_solid() -> None:
    mask, _ = mask_of_mesh(body(), 0.2)
    inside = np.argwhere(mask.data)
    assert inside.min() >= 7
    assert (np.array(mask.shape) - inside.max(axis=0)).min() >= 7


def test_a_mesh_between_voxels_is_an_error() -> None:
    vertices, faces = icosphere(2)
    with pytest.raises(NotWatertightError, match=r"working_voxel_um = 50"):
        mask_of_mesh(Surface(vertices + 3, faces), 50.0)


def test_a_sound_mesh_is_returned_as_it_is() -> None:
    for vertices, faces in (icosphere(2), torus_mesh()):
        mesh = Surface(vertices, faces)
        assert closed_mesh(mesh) is mesh


def test_a_mesh_inside_out_is_turned() -> None:
    vertices, faces = lumpy(2)
    turned = closed_mesh(Surface(vertices, faces[:, ::-1], report={"file": "cell.ply"}))
    assert signed_volume(turned.vertices, turned.faces) == pytest.approx(
        signed_volume(vertices, faces)
    )
    assert turned.report["file"] == "cell.ply"


def test_a_mesh_with_a_hole_is_closed_and_says_so() -> None:
    vertices, faces = icosphere(3)
    around = (faces == 5).any(axis=1)
    mended = closed_mesh(Surface(vertices, faces[~around]))
    assert is_watertight(mended.faces)
    assert signed_volume(mended.vertices, mended.faces) == pytest.approx(4.1, abs=0.1)
    assert len(mended.report) > 0


def test_fields_survive_a_repair() -> None:
    vertices, faces = icosphere(3)
    around = (faces == 5).any(axis=1)
    mended = closed_mesh(Surface(vertices, faces[~around], {"z": vertices[:, 0]}))
    at = np.abs(mended.fields["z"] - mended.vertices[:, 0])
    assert len(mended.fields["z"]) == len(mended.vertices)
    assert (at < 1e-9).mean() > 0.98
    assert at.max() < 0.2


def pieces(*scales: float) -> Surface:
    vertices, faces = icosphere(2)
    return Surface(
        np.concatenate([scale * vertices + 3 * i for i, scale in enumerate(scales)]),
        np.concatenate([faces + i * len(vertices) for i in range(len(scales))]),
    )


def test_two_cells_in_one_mesh_are_an_error() -> None:
    """As in a mask: which one is meant is not guessed."""
    with pytest.raises(SeveralCellsError, match="components = 2"):
        closed_mesh(pieces(1.0, 0.9))


def test_a_crumb_beside_the_cell_is_dropped_and_reported() -> None:
    mended = closed_mesh(pieces(1.0, 0.2))
    assert len(mended.vertices) == len(icosphere(2)[0])
    assert mended.report["as_given"]["components"] == 2
    assert mended.report["components"] == 1
    assert "dropped" in mended.report["repairs"][0]["what"]


def test_what_is_closed_may_still_need_repair() -> None:
    """A vertex without a face, a vertex shared with a crumb, a face without area."""
    vertices, faces = icosphere(3)
    a, b, tip = faces[0]
    flat = np.concatenate([vertices, [(vertices[a] + vertices[b]) / 2]])
    split = [[a, len(vertices), tip], [len(vertices), b, tip], [a, b, len(vertices)]]
    crumb = pieces(1.0, 0.2)
    shared = crumb.faces.copy()
    shared[shared == crumb.faces.max()] = 0
    broken = {
        "vertices without a face": Surface(np.concatenate([vertices, [[9.0, 9, 9]]]), faces),
        "without area": Surface(flat, np.concatenate([faces[1:], split])),
        "doubled where the surface met itself": Surface(crumb.vertices, shared),
    }
    for words, mesh in broken.items():
        mended = closed_mesh(mesh)
        assert any(words in repair["what"] for repair in mended.report["repairs"]), words
        assert signed_volume(mended.vertices, mended.faces) == pytest.approx(4.1, abs=0.1)
        again = closed_mesh(mended)
        assert again is mended


def test_earlier_repairs_are_not_forgotten() -> None:
    vertices, faces = icosphere(2)
    earlier = {"repairs": [{"what": "read with care", "count": 1}]}
    mended = closed_mesh(Surface(vertices, faces[:, ::-1], report=earlier))
    assert [repair["count"] for repair in mended.report["repairs"]] == [1, len(faces)]


def test_voxels_that_a_mesh_encloses_twice_or_inside_out_are_counted() -> None:
    vertices, faces = icosphere(3)
    plain, report = mask_of_mesh(Surface(vertices, faces), 0.05)
    assert "repairs" not in report
    through = vertices.copy()
    cap = through[:, 0] > 0.8
    through[cap, 0] -= 11.0 * (through[cap, 0] - 0.8)
    mask, report = mask_of_mesh(Surface(through, faces), 0.05)
    (repair,) = report["repairs"]
    assert "inside out" in repair["what"]
    assert repair["count"] > 50
    assert mask.data.sum() < plain.data.sum()
    twice = Surface(
        np.concatenate([vertices, vertices + np.array([0, 0, 1.0])]),
        np.concatenate([faces, faces + len(vertices)]),
    )
    (repair,) = mask_of_mesh(twice, 0.05)[1]["repairs"]
    assert "twice" in repair["what"]
    lens = 2 * np.pi / 3 * 0.5**2 * (3 - 0.5)
    assert repair["count"] * 0.05**3 == pytest.approx(lens, rel=0.05)
