"""One session per viewer: parameters, source and states that every widget shares."""

from __future__ import annotations

import gc
import threading
from typing import Any

import numpy as np
import pytest

from napari_unwrap3d.errors import NotGenusZeroError, ParameterError, Unwrap3DError
from napari_unwrap3d.parameters import Parameters
from napari_unwrap3d.pipeline import STEP_NAMES
from napari_unwrap3d.viewer import session as module
from napari_unwrap3d.viewer.session import Session, session_of

UM = {"scale": (0.3, 0.2, 0.2), "units": ("µm",) * 3, "axis_labels": ("z", "y", "x")}
MS = 60_000


@pytest.fixture
def session(
    make_napari_viewer: Any, fake_pipeline: Any, stack: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> Session:
    monkeypatch.setattr(module, "DEBOUNCE_MS", 20)
    viewer = make_napari_viewer()
    layer = viewer.add_image(stack, name="stack", **UM)
    made = session_of(viewer)
    made.set_source(layer)
    return made


def blend(session: Session, value: float) -> None:
    session.set_values("sphere", {"blend": value})


def finish(session: Session, qtbot: Any, until: str = "") -> None:
    with qtbot.waitSignal(session.finished, timeout=MS):
        session.run(until)
    qtbot.waitUntil(lambda: not session.running, timeout=MS)


def states(session: Session) -> list[str]:
    return [step.state for step in session.steps.values()]


def test_a_run_up_to_a_step_leaves_the_rest(
    session: Session, qtbot: Any, fake_pipeline: Any
) -> None:
    assert session.next_step() == "stack"
    finish(session, qtbot, "sealed")
    assert fake_pipeline.made[0].computed == [["stack", "surface", "sealed"]]
    assert states(session)[:4] == ["done", "done", "done", "ready"]
    assert session.next_step() == "reference"
    assert "needs Reference first" in session.steps["sphere"].reason
    assert session.atlas is not None


def test_no_frame_in_3d_shows_the_stack(session: Session, qtbot: Any) -> None:
    viewer = session.viewer
    assert viewer is not None
    stack, shown = viewer.layers["stack"], list[bool]()
    viewer.dims.events.ndisplay.connect(lambda _: shown.append(stack.visible))
    finish(session, qtbot, "surface")
    assert viewer.dims.ndisplay == 3
    assert shown == [False]


def test_a_run_up_to_an_early_step_keeps_later_charts_that_hold(
    session: Session, qtbot: Any
) -> None:
    finish(session, qtbot)
    finish(session, qtbot, "stack")
    assert session.atlas is not None
    assert session.atlas.has("sphere")
    assert not session.next_step()


def test_a_moved_slider_computes_its_step_and_what_follows(
    session: Session, qtbot: Any, fake_pipeline: Any
) -> None:
    finish(session, qtbot)
    with qtbot.waitSignal(session.finished, timeout=MS):
        for value in (0.9, 0.8, 0.7):
            blend(session, value)
        assert session.steps["sphere"].state == "stale"
    computed = fake_pipeline.made[0].computed
    assert computed == [list(STEP_NAMES), ["sphere", "uv", "topography"]]


def test_before_the_first_run_a_moved_slider_starts_nothing(session: Session, qtbot: Any) -> None:
    blend(session, 0.5)
    assert not session._rest.isActive()


def test_updating_can_be_switched_off(session: Session, qtbot: Any) -> None:
    finish(session, qtbot)
    session.update_automatically = False
    blend(session, 0.5)
    assert not session._rest.isActive()
    assert session.steps["sphere"].state == "stale"


def test_a_slider_moved_during_a_run_cancels_it_and_starts_anew(
    session: Session, qtbot: Any, fake_pipeline: Any
) -> None:
    stopped: list[str] = []
    session.stopped.connect(stopped.append)
    fake_pipeline.behaviour["uv"] = 60.0
    session.run()
    qtbot.waitUntil(lambda: session.steps["uv"].state == "running", timeout=MS)
    fake_pipeline.behaviour.clear()
    with qtbot.waitSignal(session.finished, timeout=MS):
        blend(session, 0.5)
    (pipeline,) = fake_pipeline.made
    assert pipeline.computed[-1] == ["sphere", "uv", "topography"]
    assert not stopped, "the user cancelled nothing"
    assert session.atlas is not None
    assert session.atlas.parameters is not None


def test_cancelling_also_forgets_what_would_start_anew(
    session: Session, qtbot: Any, fake_pipeline: Any
) -> None:
    fake_pipeline.behaviour["uv"] = 60.0
    session.run()
    qtbot.waitUntil(lambda: session.steps["uv"].state == "running", timeout=MS)
    blend(session, 0.5)
    with qtbot.waitSignal(session.stopped, timeout=MS):
        session.cancel_by_user()
    assert not session.running


def test_moving_back_before_it_rests_computes_nothing(
    session: Session, qtbot: Any, fake_pipeline: Any
) -> None:
    finish(session, qtbot)
    with qtbot.waitSignal(session.settled, timeout=MS):
        blend(session, 0.5)
        blend(session, 1.0)
    assert len(fake_pipeline.made[0].computed) == 1


@pytest.mark.parametrize("step", ["direct", "plane"])
def test_charts_on_request_are_steps_too(
    session: Session, qtbot: Any, fake_pipeline: Any, step: str
) -> None:
    finish(session, qtbot)
    assert session.steps[step].state == "ready"
    finish(session, qtbot, step)
    assert session.steps[step].state == "done"
    assert fake_pipeline.made[0].computed[-1] == [step]
    with qtbot.waitSignal(session.finished, timeout=MS):
        blend(session, 0.5)
    assert fake_pipeline.made[0].computed[-1] == ["sphere", "uv", "topography", step]


def test_charts_are_told_as_they_are_done(session: Session, qtbot: Any, fake_pipeline: Any) -> None:
    told: list[set[str]] = []
    session.charts_changed.connect(lambda charts: told.append(set(charts)))
    finish(session, qtbot)
    assert set() in told
    assert {"mask", "surface"} in told
    assert told[-1] == set(session.charts) == {"mask", "surface", "reference", "sphere"}


def test_the_work_is_done_in_another_thread(
    session: Session, qtbot: Any, fake_pipeline: Any
) -> None:
    finish(session, qtbot)
    assert threading.main_thread().name not in fake_pipeline.made[0].threads


@pytest.mark.usefixtures("real_collector")
def test_the_collector_is_quiet_during_a_run_only(
    session: Session, qtbot: Any, fake_pipeline: Any
) -> None:
    finish(session, qtbot, "stack")
    assert gc.get_freeze_count() == 0
    fake_pipeline.behaviour["uv"] = 60.0
    session.run()
    assert gc.get_freeze_count() > 0
    assert session.viewer is not None
    session.viewer.close()
    assert gc.get_freeze_count() == 0


def test_placing_yields_between_layers(session: Session, qtbot: Any, monkeypatch: Any) -> None:
    """In every turn of the event loop at most one layer is added."""
    viewer = session.viewer
    assert viewer is not None
    counts: list[int] = []
    turn = session.turns._do_next

    def counting() -> None:
        before = len(viewer.layers)
        turn()
        counts.append(len(viewer.layers) - before)

    session.turns._timer.timeout.disconnect()
    session.turns._timer.timeout.connect(counting)
    finish(session, qtbot)
    assert max(counts) == 1
    assert sum(counts) == len(viewer.layers) - 1


def test_what_is_out_of_range_is_that_steps_problem(session: Session, qtbot: Any) -> None:
    session.set_values("reference", {"delta": -1})
    assert session.steps["reference"].state == "not ready"
    assert "reference.delta" in session.steps["reference"].reason
    with pytest.raises(ParameterError, match=r"reference\.delta"):
        session.run()
    session.set_values("reference", {"delta": 5e-4})
    assert session.steps["reference"].brief == "after Stack"
    finish(session, qtbot, "stack")


def test_a_failed_step_says_why_until_something_changes(
    session: Session, qtbot: Any, fake_pipeline: Any, errors: list[str]
) -> None:
    fake_pipeline.behaviour["sphere"] = NotGenusZeroError("Not a ball.", hint="Seal it.")
    with qtbot.waitSignal(session.stopped, timeout=MS):
        session.run()
    assert session.steps["sphere"].state == "failed"
    assert "Not a ball." in session.steps["sphere"].reason
    assert len(errors) == 1
    session.update_automatically = False
    blend(session, 0.5)
    assert session.steps["sphere"].state != "failed"


def test_without_a_source_nothing_runs_and_it_says_why(make_napari_viewer: Any) -> None:
    session = session_of(make_napari_viewer())
    assert set(states(session)) == {"not ready"}
    assert "Open a stack" in session.blocked()
    with pytest.raises(Unwrap3DError, match="Open a stack"):
        session.run()


def test_another_source_starts_with_no_run_behind_it(
    session: Session, qtbot: Any, stack: np.ndarray
) -> None:
    finish(session, qtbot)
    assert session.viewer is not None
    with qtbot.waitSignal(session.source_changed, timeout=MS):
        session.set_source(session.viewer.add_image(stack[::-1], **UM))
    blend(session, 0.5)
    assert not session._rest.isActive(), "a cell is unwrapped when the user says so"


def test_the_parameters_are_told_once_and_only_when_they_change(session: Session) -> None:
    told: list[Parameters] = []
    session.parameters_changed.connect(told.append)
    session.set_parameters(Parameters.preset("ruffles"))
    session.set_parameters(Parameters.preset("ruffles"))
    assert told == [Parameters.preset("ruffles")]
