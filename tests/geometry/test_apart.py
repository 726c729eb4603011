"""What is done in another process is what would be done here, to the last bit."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from napari_unwrap3d.errors import Cancelled
from napari_unwrap3d.geometry import apart as module
from napari_unwrap3d.geometry import compiled
from napari_unwrap3d.geometry.apart import Gone, Helper, apart
from napari_unwrap3d.geometry.marching import clamped_marching_cubes
from napari_unwrap3d.geometry.remesh import simplify
from shapes import icosphere, lumpy


@pytest.fixture
def nothing_here(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """From when it is called, whoever uses the libraries in this process fails."""

    def forbid() -> None:
        def used(*_: Any) -> None:
            raise AssertionError("done in this process")

        for name in ("decimated", "marched"):
            monkeypatch.setattr(compiled, name, used)

    return forbid


def everything() -> list[np.ndarray]:
    """What every library gives, on small data."""
    vertices, faces = lumpy(3)
    index = np.indices((12, 12, 12)).astype(np.float32)
    field = 4.3 - np.linalg.norm(index - 5.4, axis=0)
    return [*simplify(vertices, faces, 200), *clamped_marching_cubes(field)]


def test_every_bit_is_the_same(nothing_here: Callable[[], None]) -> None:
    here = everything()
    nothing_here()
    with apart():
        there = everything()
    for one, other in zip(here, there, strict=True):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)


def test_what_a_lost_process_should_have_done_is_done_here() -> None:
    vertices, faces = icosphere(2)
    with apart():
        expected = simplify(vertices, faces, 60)
        assert module._helper is not None
        assert module._helper._process is not None
        module._helper._process.kill()
        for one, other in zip(expected, simplify(vertices, faces, 60), strict=True):
            np.testing.assert_array_equal(one, other)


def test_without_a_program_to_start_it_is_done_here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module.sys, "executable", "/opt/a-bundle/napari")
    with apart():
        assert len(simplify(*icosphere(2), 60)[0]) < 100
        assert module._helper is not None
        assert module._helper._process is None


def test_errors_come_back() -> None:
    with apart():
        helper = module._helper
        assert helper is not None
        with pytest.raises(TypeError, match="decimated"):
            helper.call("decimated")
        assert len(helper.call("decimated", *_float32(2), 100)) == 2, "and it goes on"


def test_one_process_serves_all_and_ends_with_the_last() -> None:
    with apart():
        first = module._helper
        assert first is not None
        assert len(first.call("decimated", *_float32(1), 10)) == 2
        with apart():
            assert module._helper is first
        assert module._helper is first
        process = first._process
        assert process is not None
    assert module._helper is None
    assert process.poll() is not None
    with pytest.raises(Gone):
        first.call("decimated", *_float32(1), 10)


def test_who_still_waits_at_the_end_is_cancelled() -> None:
    """The thread of a cancelled run must not begin here what it had asked for."""
    helper, outcome, asking = Helper(), list[Cancelled](), threading.Event()
    send = module._send

    def ask() -> None:
        try:
            helper.call("marched", np.random.default_rng(0).normal(size=(120, 120, 120)))
        except Cancelled as error:
            outcome.append(error)

    def sent(*arguments: Any) -> None:
        send(*arguments)
        asking.set()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_send", sent)
        thread = threading.Thread(target=ask)
        thread.start()
        assert asking.wait(10.0)
        helper.close()
        thread.join(10.0)
    assert isinstance(outcome[0], Cancelled)


def _float32(level: int) -> tuple[np.ndarray, np.ndarray]:
    vertices, faces = icosphere(level)
    return vertices.astype(np.float32), faces.astype(np.int32)
