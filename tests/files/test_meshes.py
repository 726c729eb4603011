"""Meshes survive the way through every format, and damaged files are named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from napari_unwrap3d.errors import FileFormatError, InputError, MeshError, NotWatertightError
from napari_unwrap3d.files.meshes import FIELD_SUFFIXES, MESH_SUFFIXES, read_mesh, write_mesh
from napari_unwrap3d.geometry.mesh import is_watertight, mesh_report, signed_volume


@pytest.fixture
def chiral() -> tuple[np.ndarray, np.ndarray]:
    """A closed screw-like solid that no rotation makes its own mirror image."""
    shape = trimesh.creation.box((2.0, 3.0, 4.0)).subdivide().subdivide()
    z, y, x = np.array(shape.vertices).T
    turn = 0.6 * z
    twisted = np.stack(
        [z + 20.0, y * np.cos(turn) - x * np.sin(turn), y * np.sin(turn) + x * np.cos(turn) - 7.0]
    )
    return twisted.T, np.array(shape.faces, dtype=np.int64)


def twist(vertices: np.ndarray) -> float:
    """Changes its sign under reflection; for the solid above about its volume of twist."""
    centred = vertices - vertices.mean(axis=0)
    z, y, x = centred.T
    ahead = np.cos(0.6 * z) * y + np.sin(0.6 * z) * x
    behind = np.cos(0.6 * z) * y - np.sin(0.6 * z) * x
    return float(np.abs(ahead).max() - np.abs(behind).max())


def sorted_rows(array: np.ndarray) -> np.ndarray:
    return array[np.lexsort(array.T)]


@pytest.mark.parametrize("suffix", MESH_SUFFIXES)
def test_round_trip_keeps_shape_place_and_handedness(
    tmp_path: Path, chiral: tuple[np.ndarray, np.ndarray], suffix: str
) -> None:
    vertices, faces = chiral
    surface = read_mesh(write_mesh(tmp_path / f"cell{suffix}", vertices, faces))
    assert sorted_rows(surface.vertices) == pytest.approx(sorted_rows(vertices), abs=1e-5)
    assert len(surface.faces) == len(faces)
    assert is_watertight(surface.faces)
    assert signed_volume(surface.vertices, surface.faces) == pytest.approx(
        signed_volume(vertices, faces), rel=1e-5
    )
    assert signed_volume(vertices, faces) > 0
    assert twist(surface.vertices) == pytest.approx(twist(vertices), abs=1e-4)
    assert abs(twist(vertices)) > 0.1


@pytest.mark.parametrize("suffix", [s for s in MESH_SUFFIXES if s != ".stl"])
def test_round_trip_keeps_the_numbering(
    tmp_path: Path, chiral: tuple[np.ndarray, np.ndarray], suffix: str
) -> None:
    vertices, faces = chiral
    surface = read_mesh(write_mesh(tmp_path / f"cell{suffix}", vertices, faces))
    assert surface.vertices == pytest.approx(vertices, abs=1e-5)
    assert np.array_equal(surface.faces, faces)
    assert surface.report["repairs"] == []


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".stl", ".off"])
def test_another_reader_sees_xyz_with_the_outside_outside(
    tmp_path: Path, chiral: tuple[np.ndarray, np.ndarray], suffix: str
) -> None:
    vertices, faces = chiral
    path = write_mesh(tmp_path / f"cell{suffix}", vertices, faces)
    loaded = trimesh.load_mesh(path)
    assert loaded.volume == pytest.approx(signed_volume(vertices, faces), rel=1e-5)
    assert loaded.vertices.mean(axis=0)[2] == pytest.approx(20.0, abs=0.5)


def test_vtp_holds_xyz(tmp_path: Path, chiral: tuple[np.ndarray, np.ndarray]) -> None:
    from vtkmodules.vtkFiltersCore import vtkMassProperties
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

    vertices, faces = chiral
    reader = vtkXMLPolyDataReader()
    reader.SetFileName(str(write_mesh(tmp_path / "cell.vtp", vertices, faces)))
    measured = vtkMassProperties()
    measured.SetInputConnection(reader.GetOutputPort())
    measured.Update()
    assert measured.GetVolume() == pytest.approx(signed_volume(vertices, faces), rel=1e-4)
    bounds = reader.GetOutput().GetBounds()
    assert bounds[4:] == pytest.approx((vertices[:, 0].min(), vertices[:, 0].max()), abs=1e-5)


@pytest.mark.parametrize("suffix", FIELD_SUFFIXES)
def test_fields_come_back(
    tmp_path: Path, chiral: tuple[np.ndarray, np.ndarray], suffix: str
) -> None:
    vertices, faces = chiral
    fields = {
        "mean_curvature_per_um": np.linspace(-1, 1, len(vertices)),
        "label": np.arange(len(vertices)) - 3,
        "inside": np.arange(len(vertices)) % 2 == 0,
    }
    surface = read_mesh(write_mesh(tmp_path / f"cell{suffix}", vertices, faces, fields))
    assert set(surface.fields) == set(fields)
    for name, values in fields.items():
        assert surface.fields[name] == pytest.approx(values.astype(float), abs=1e-6), name
    assert surface.fields["label"].dtype.kind == "i"


def test_fields_follow_their_vertices_through_a_repair(
    tmp_path: Path, chiral: tuple[np.ndarray, np.ndarray]
) -> None:
    vertices, faces = chiral
    soup = vertices[faces].reshape(-1, 3)
    path = write_mesh(
        tmp_path / "soup.ply", soup, np.arange(len(soup)).reshape(-1, 3), {"height": soup[:, 0]}
    )
    surface = read_mesh(path)
    assert len(surface.vertices) == len(vertices)
    assert surface.fields["height"] == pytest.approx(surface.vertices[:, 0], abs=1e-5)
    untouched = read_mesh(path, repaired=False)
    assert len(untouched.vertices) == len(soup)
    assert untouched.report["boundary_edges"] == 3 * len(faces)


def test_vector_fields_are_split_into_properties_of_a_ply(
    tmp_path: Path, chiral: tuple[np.ndarray, np.ndarray]
) -> None:
    vertices, faces = chiral
    path = write_mesh(tmp_path / "cell.ply", vertices, faces, {"my field": vertices})
    surface = read_mesh(path)
    assert sorted(surface.fields) == ["my_field_0", "my_field_1", "my_field_2"]
    assert surface.fields["my_field_2"] == pytest.approx(vertices[:, 2], abs=1e-5)


def test_fields_that_a_format_cannot_hold_are_logged(
    tmp_path: Path, chiral: tuple[np.ndarray, np.ndarray], caplog: pytest.LogCaptureFixture
) -> None:
    vertices, faces = chiral
    write_mesh(tmp_path / "cell.stl", vertices, faces, {"label": np.zeros(len(vertices))})
    assert "label" in caplog.text


def test_the_unit_of_the_file_can_be_given(
    tmp_path: Path, chiral: tuple[np.ndarray, np.ndarray]
) -> None:
    vertices, faces = chiral
    path = write_mesh(tmp_path / "nm.ply", vertices * 1000, faces)
    volume = read_mesh(path, scale=1e-3).report["volume_um3"]
    assert volume == pytest.approx(signed_volume(vertices, faces), rel=1e-4)
    with pytest.raises(InputError, match="scale = 0"):
        read_mesh(path, scale=0)


def test_quads_are_read_as_triangles(tmp_path: Path) -> None:
    box = np.array([[z, y, x] for z in (0, 1) for y in (0, 1) for x in (0, 1)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    rows = ["v {} {} {}".format(*vertex) for vertex in box]
    rows += ["f {} {} {} {}".format(*(corner + 1 for corner in quad)) for quad in quads]
    (tmp_path / "box.obj").write_text("\n".join(rows))
    surface = read_mesh(tmp_path / "box.obj")
    assert len(surface.faces) == 12
    assert surface.report["volume_um3"] == pytest.approx(1.0)


@pytest.mark.parametrize("suffix", MESH_SUFFIXES)
@pytest.mark.parametrize("kept", [0.0, 0.1, 0.5, 0.97])
def test_truncated_files_are_never_read_in_silence(
    tmp_path: Path,
    chiral: tuple[np.ndarray, np.ndarray],
    capfd: pytest.CaptureFixture[str],
    suffix: str,
    kept: float,
) -> None:
    path = write_mesh(tmp_path / f"cell{suffix}", *chiral)
    content = path.read_bytes()
    path.write_bytes(content[: int(kept * len(content))])
    # An OBJ file does not say how many faces it should have: what is missing shows as a hole.
    errors = (FileFormatError, NotWatertightError) if suffix == ".obj" else FileFormatError
    with pytest.raises(errors) as raised:
        read_mesh(path)
    assert path.name in str(raised.value) or "hole" in str(raised.value)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    ("suffix", "declared"),
    [
        (".ply", b"element vertex "),
        (".ply", b"element face "),
        (".vtp", b'NumberOfPoints="'),
        (".vtp", b'NumberOfPolys="'),
        (".off", b"OFF\n"),
    ],
)
def test_a_file_that_declares_more_than_it_holds_is_refused(
    tmp_path: Path, chiral: tuple[np.ndarray, np.ndarray], suffix: str, declared: bytes
) -> None:
    """Also where its reader would allocate first: VTK ends the process then."""
    path = write_mesh(tmp_path / f"cell{suffix}", *chiral)
    before, after = path.read_bytes().split(declared, 1)
    path.write_bytes(before + declared + b"999999999" + after)
    with pytest.raises(FileFormatError, match=path.name):
        read_mesh(path)


@pytest.mark.parametrize("suffix", MESH_SUFFIXES)
def test_other_content_is_refused(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"cell{suffix}"
    path.write_bytes(bytes(range(256)) * 4)
    with pytest.raises(FileFormatError, match=path.name):
        read_mesh(path)


def test_a_point_cloud_is_refused(tmp_path: Path) -> None:
    header = "ply\nformat ascii 1.0\nelement vertex 2\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz")
    (tmp_path / "points.ply").write_text(f"{header}end_header\n0 0 0\n1 1 1\n")
    with pytest.raises(FileFormatError, match="no triangles"):
        read_mesh(tmp_path / "points.ply")


def test_unknown_kinds_and_missing_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"cell\.fbx.*\.ply"):
        read_mesh(tmp_path / "cell.fbx")
    with pytest.raises(FileFormatError, match="no file"):
        read_mesh(tmp_path / "cell.ply")
    with pytest.raises(FileFormatError, match=r"\.fbx"):
        write_mesh(tmp_path / "cell.fbx", np.eye(3), [[0, 1, 2]])


def test_a_failed_write_leaves_what_was_there(
    tmp_path: Path, chiral: tuple[np.ndarray, np.ndarray]
) -> None:
    vertices, faces = chiral
    path = write_mesh(tmp_path / "cell.ply", vertices, faces)
    before = path.read_bytes()
    with pytest.raises(MeshError, match="wrong shape"):
        write_mesh(path, vertices, faces, {"label": np.zeros(3)})
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["cell.ply"]


@pytest.mark.parametrize(
    ("name", "genus", "volume"),
    [
        ("midgut_mesh_20.ply", 0, 73837835.2),
        ("branchoid.ply", 0, 92461.17),
        ("gastruloid.ply", 0, 4747307.4),
        ("knot.ply", 1, 1053504.8),
        ("torus.obj", 1, 1.2187845),
        ("spot.obj", 0, 0.7182588),
    ],
)
def test_real_meshes(shared_data: Path, name: str, genus: int, volume: float) -> None:
    surface = read_mesh(shared_data / "meshes" / name)
    assert surface.report["watertight"]
    assert surface.report["genus"] == genus
    assert surface.report["volume_um3"] == pytest.approx(volume, rel=1e-6)
    assert surface.report["file"] == name
    assert mesh_report(surface.vertices, surface.faces)["genus"] == genus


def test_texture_seams_of_an_obj_are_joined(shared_data: Path) -> None:
    surface = read_mesh(shared_data / "meshes" / "spot.obj")
    assert len(surface.vertices) == 2930
    assert surface.report["as_given"]["boundary_edges"] > 0
