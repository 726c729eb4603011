"""Steps of the pipeline that run when somebody asks: direct, plane and protrusions."""

import numpy as np
import pytest

from napari_unwrap3d import requested
from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.errors import (
    Cancelled,
    ChartMissingError,
    NotCertifiedError,
)
from napari_unwrap3d.pipeline import ON_REQUEST, STEP_NAMES, Pipeline
from napari_unwrap3d.protrusions.editing import ProtrusionEdits
from pipelines import cancelling_after, changed, copy_of
from shapes import QUICK


def test_the_plane_is_computed_on_request_only(small_pipeline: Pipeline) -> None:
    assert [step.name for step in ON_REQUEST] == ["direct", "plane", "protrusions"]
    assert "plane" not in small_pipeline.state(QUICK)
    pipeline = copy_of(small_pipeline)
    wanted = changed("plane", compute=True)
    assert pipeline.state(wanted)["plane"] == "missing"
    assert not pipeline.run(wanted, until="uv").has("plane")
    seen: list[str] = []
    atlas = pipeline.run(wanted, lambda step, fraction, message: seen.append(step))
    assert set(seen) == {"plane"}
    assert atlas.has("plane")
    assert list(atlas.quality) == [*STEP_NAMES, "plane"]
    assert "plane" in atlas.provenance["steps"]
    # Asking by name or by parameter is the same request, and nothing runs again.
    seen.clear()
    again = pipeline.run(QUICK, lambda step, fraction, message: seen.append(step), until="plane")
    assert seen == []
    assert again.plane is atlas.plane
    assert pipeline.state(QUICK)["plane"] == "done"
    assert pipeline.state(changed("plane", delta=100.0))["plane"] == "stale"
    assert pipeline.state(changed("sealed", handles="cut"))["plane"] == "stale"
    assert not pipeline.run(QUICK).has("plane")


def test_the_protrusions_are_a_step_on_request(small_pipeline: Pipeline) -> None:
    assert "protrusions" not in small_pipeline.state(QUICK)
    pipeline = copy_of(small_pipeline)
    assert pipeline.state(changed("protrusions", compute=True))["protrusions"] == "missing"
    seen: list[str] = []
    fractions: list[float] = []

    def report(step: str, fraction: float, message: str) -> None:
        seen.append(step)
        fractions.append(fraction)

    atlas = pipeline.run(changed("protrusions", compute=True), report)
    assert set(seen) == {"protrusions"}
    assert fractions == sorted(fractions)
    assert list(atlas.quality) == [*STEP_NAMES, "protrusions"]
    assert atlas.quality["protrusions"]["protrusions"] == atlas.protrusions.count > 0
    assert abs(atlas.quality["protrusions"]["parts_difference"]) < 0.005
    assert pipeline.state(QUICK)["protrusions"] == "done"
    # Its key depends on its own two groups and on the charts before it, and on no others.
    assert pipeline.state(changed("protrusions", radius=0.3))["protrusions"] == "stale"
    assert pipeline.state(changed("uv", rows=40))["protrusions"] == "stale"
    assert pipeline.state(changed("plane", delta=100.0))["protrusions"] == "done"
    assert not pipeline.run(QUICK).has("protrusions")


def test_the_key_of_the_protrusions_has_every_parameter_of_both_methods(
    small_pipeline: Pipeline,
) -> None:
    step = next(step for step in ON_REQUEST if step.name == "protrusions")
    assert step.parameters == ("protrusions", "topographic", "refinement")
    plain = small_pipeline._key(step, QUICK)
    assert small_pipeline._key(step, changed("protrusions", compute=True)) == plain
    assert small_pipeline._key(step, changed("protrusions", method="topography")) != plain


def test_edited_protrusions_are_the_result_of_their_step(small_pipeline: Pipeline) -> None:
    pipeline = copy_of(small_pipeline)
    atlas = pipeline.run(QUICK, until="protrusions")
    edits = ProtrusionEdits(atlas)
    edits.delete(int(atlas.protrusions.columns["label"][0]))
    kept = edits.keep(pipeline)
    again = pipeline.run(QUICK, until="protrusions")
    assert again.protrusions is kept is atlas.protrusions
    assert again.quality["protrusions"] == atlas.quality["protrusions"]
    assert pipeline.state(QUICK)["protrusions"] == "done"
    # What came since is taken by whoever edits.
    assert atlas.completed(pipeline.run(QUICK, until="protrusions"))
    # A pipeline that never found any has nothing to put it in the place of.
    edits.keep(copy_of(small_pipeline))


def test_progress_of_the_plane_runs_from_zero_to_one(small_pipeline: Pipeline) -> None:
    fractions: list[float] = []
    copy_of(small_pipeline).run(
        QUICK, lambda step, fraction, message: fractions.append(fraction), until="plane"
    )
    assert fractions == sorted(fractions)
    assert (fractions[0], fractions[-1]) == (0.0, 1.0)


def test_the_plane_can_be_cancelled_at_any_moment(small_pipeline: Pipeline) -> None:
    for moment in (1, 3, 6):
        pipeline = copy_of(small_pipeline)
        with pytest.raises(Cancelled):
            pipeline.run(QUICK, cancelling_after(moment), until="plane")
        assert "plane" not in pipeline.kept


def test_a_plane_that_is_not_certified_is_missing_with_the_reason(
    small_pipeline: Pipeline, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = {"position_um": (1.0, 2.0, 3.0), "position_vu": (4.0, 5.0), "faces": 6}

    def refuse(*_: object) -> None:
        raise NotCertifiedError(
            "Faces are flipped.", places=(place,), flipped_faces=6, hint="Use the direct chart."
        )

    monkeypatch.setattr(requested, "plane", refuse)
    pipeline = copy_of(small_pipeline)
    atlas = pipeline.run(QUICK, until="plane")
    assert not atlas.has("plane")
    assert atlas.has("topography")
    numbers = atlas.quality["plane"]
    assert numbers["certified"] is False
    assert numbers["flipped_faces"] == 6
    assert numbers["places"] == [place]
    with pytest.raises(ChartMissingError, match="flipped_faces = 6") as caught:
        _ = atlas.plane
    assert caught.value.hint == "Use the direct chart."
    assert any("certified" in warning for warning in atlas.provenance["warnings"])
    assert pipeline.state(QUICK)["plane"] == "done"


def test_the_plane_is_the_same_bit_for_bit(small_pipeline: Pipeline, plane_atlas: Atlas) -> None:
    again = copy_of(small_pipeline).run(QUICK, until="plane")
    np.testing.assert_array_equal(again.plane.vertices, plane_atlas.plane.vertices)
    np.testing.assert_array_equal(again.plane.face, plane_atlas.plane.face)
    assert again.quality["plane"] == plane_atlas.quality["plane"]
