"""Progress: fractions of parts, cancellation from any thread, errors of other threads."""

import threading

import pytest

from napari_unwrap3d.errors import Cancelled
from napari_unwrap3d.progress import Progress, silent

Seen = list[tuple[str, float, str]]


def recorder() -> tuple[Progress, Seen]:
    seen: Seen = []
    return Progress(lambda *report: seen.append(report), "uv"), seen


def test_reports_arrive_with_step_fraction_and_message() -> None:
    progress, seen = recorder()
    progress(0.25, "a quarter")
    progress(1.0)
    assert seen == [("uv", 0.25, "a quarter"), ("uv", 1.0, "")]


def test_fractions_stay_between_zero_and_one() -> None:
    progress, seen = recorder()
    progress(-1.0)
    progress(7)
    progress.part(0.2, 0.4)(3.0)
    assert [fraction for _, fraction, _ in seen] == [0.0, 1.0, pytest.approx(0.4)]


def test_parts_of_parts_are_mapped_to_the_whole() -> None:
    progress, seen = recorder()
    inner = progress.part(0.5, 1.0).part(0.2, 0.6)
    inner(0.0)
    inner(0.5)
    inner(1.0)
    assert [fraction for _, fraction, _ in seen] == pytest.approx([0.6, 0.7, 0.8])


def test_another_step_starts_at_zero_and_shares_the_cancellation() -> None:
    progress, seen = recorder()
    other = progress.part(0.5, 1.0).named("sphere")
    other(0.5)
    assert seen == [("sphere", 0.5, "")]
    other.cancel()
    with pytest.raises(Cancelled, match="last finished step"):
        progress.check()


@pytest.mark.parametrize("call", [lambda p: p(0.5), lambda p: p.check(), lambda p: p.run(int)])
def test_every_call_raises_after_a_cancellation_and_reports_no_more(call) -> None:
    progress, seen = recorder()
    progress.part(0, 1).cancel()
    with pytest.raises(Cancelled):
        call(progress)
    assert seen == []


def test_run_passes_arguments_and_the_result() -> None:
    assert silent().run(divmod, 17, 5) == (3, 2)
    assert silent().run(sorted, [1, 3, 2], reverse=True) == [3, 2, 1]


def test_run_passes_errors_on() -> None:
    with pytest.raises(ZeroDivisionError):
        silent().run(divmod, 1, 0)
    with pytest.raises(KeyboardInterrupt):
        silent().run(_interrupted)


def _interrupted() -> None:
    raise KeyboardInterrupt


def test_run_returns_at_once_when_cancelled_although_the_function_does_not() -> None:
    progress = Progress()
    started, release, finished = threading.Event(), threading.Event(), threading.Event()

    def stubborn() -> None:
        started.set()
        release.wait(30)
        finished.set()

    def cancel_when_started() -> None:
        started.wait(30)
        progress.cancel()

    threading.Thread(target=cancel_when_started).start()
    with pytest.raises(Cancelled):
        progress.run(stubborn)
    assert not finished.is_set()
    release.set()
    assert finished.wait(30)


def test_a_result_that_comes_after_the_cancellation_is_dropped() -> None:
    progress = Progress()
    with pytest.raises(Cancelled):
        progress.run(progress.cancel)


def test_a_silent_reporter_never_complains() -> None:
    progress = silent()
    progress(0.5, "nobody hears")
    assert progress is not silent()
