import numpy as np
import pytest

from napari_unwrap3d.geometry.picking import RayPicker
from synthetic import icosphere


def two_spheres():
    """One sphere of radius 1 at the origin, and a smaller one behind it at z = 5."""
    vertices, faces = icosphere(3)
    both = np.concatenate([vertices, 0.5 * vertices + [5.0, 0.0, 0.0]])
    return both, np.concatenate([faces, faces + len(vertices)]), len(faces)


@pytest.mark.parametrize("start", [-20.0, 0.3, 20.0])
@pytest.mark.parametrize("length", [1.0, 1e-3])
def test_the_first_face_along_a_line_is_found_wherever_the_line_is_given(start, length):
    vertices, faces, one = two_spheres()
    found = RayPicker(vertices, faces).pick([start, 0.2, 0.1], [length, 0.0, 0.0])
    assert found is not None
    face, weights = found
    assert face < one
    point = weights @ vertices[faces[face]]
    np.testing.assert_allclose(point[1:], [0.2, 0.1], atol=1e-9)
    assert point[0] < -0.9


def test_looking_from_behind_finds_the_other_side():
    vertices, faces, one = two_spheres()
    face, _ = RayPicker(vertices, faces).pick([0.0, 0.2, 0.1], [-1.0, 0.0, 0.0])
    assert face >= one


def test_a_line_beside_the_mesh_finds_nothing():
    vertices, faces, _ = two_spheres()
    picker = RayPicker(vertices, faces)
    assert picker.pick([0.0, 3.0, 0.0], [1.0, 0.0, 0.0]) is None
    hits = picker.pick_many([[0, 3.0, 0], [0, 0.1, 0.2]], [[1.0, 0, 0]] * 2)
    assert hits.line.tolist() == [1]


def test_what_something_hides_is_not_visible():
    vertices, faces, _ = two_spheres()
    picker = RayPicker(vertices, faces)
    every = np.arange(len(vertices))
    seen = picker.visible(every, np.tile([1.0, 0.0, 0.0], (len(every), 1)))
    big = every < len(vertices) // 2
    # The small sphere is behind the large one; of that its near half is seen.
    assert not seen[~big].any()
    assert seen[big & (vertices[:, 0] < -0.1)].all()
    assert not seen[big & (vertices[:, 0] > 0.1)].any()
