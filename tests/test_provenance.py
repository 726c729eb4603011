"""Hashes of contents, versions, and repairs in words."""

import numpy as np
import pytest

from napari_unwrap3d.provenance import content_hash, environment, package_version, repairs


def test_equal_contents_have_equal_hashes() -> None:
    array = np.arange(24.0).reshape(2, 3, 4)
    assert content_hash(array, "a", 1) == content_hash(array.copy(), "a", 1)
    assert content_hash(np.asfortranarray(array)) == content_hash(array)
    assert content_hash(array[:, ::2]) == content_hash(array[:, ::2].copy())


@pytest.mark.parametrize(
    "other",
    [
        (np.arange(6, dtype=np.int32),),
        (np.arange(6.0),),
        (np.arange(6).reshape(2, 3),),
        (np.arange(6)[::-1],),
        (np.arange(6), None),
        (np.arange(6), ""),
        (np.zeros(0, np.int64),),
        (list(range(6)),),
    ],
)
def test_other_contents_have_other_hashes(other: tuple[object, ...]) -> None:
    assert content_hash(*other) != content_hash(np.arange(6))


def test_parts_do_not_run_together() -> None:
    assert content_hash("ab", "c") != content_hash("a", "bc")
    assert content_hash("1") != content_hash(1)


def test_versions_are_those_that_are_installed() -> None:
    found = environment()
    assert found["numpy"] == np.__version__
    assert package_version("no-such-package-anywhere") == "unknown"
    assert all(isinstance(value, str) for value in found.values())


def test_repairs_are_told_in_words_and_nothing_else_is() -> None:
    numbers = {
        "stack": {"voxels": 9, "filled_voxels": 0, "dropped_components": 2},
        "surface": {"genus": 1, "voxels_lost_by_smoothing": 7},
        "sealed": {"sealed_parts": 0},
    }
    assert repairs(numbers) == [
        "stack: dropped components = 2",
        "surface: voxels lost by smoothing = 7",
    ]
    mesh = {"surface": {"repairs": [{"what": "small holes were closed", "count": 3}]}}
    assert repairs(mesh) == ["surface: small holes were closed (3)"]
