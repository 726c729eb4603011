"""The form shows what the models say and gives back what they take."""

from __future__ import annotations

import pytest
from qtpy.QtCore import QPoint, QPointF, Qt
from qtpy.QtGui import QWheelEvent
from qtpy.QtWidgets import QApplication

from napari_unwrap3d.errors import ParameterError
from napari_unwrap3d.parameters import PRESETS, Parameters
from napari_unwrap3d.viewer.common.forms import ParametersForm

MAIN = ("sphere.blend", "uv.rows", "topography.depth_um")


@pytest.fixture
def form(qtbot: object) -> ParametersForm:
    made = ParametersForm(Parameters(), MAIN)
    qtbot.addWidget(made)  # type: ignore[attr-defined]
    made.show()
    return made


def visible(form: ParametersForm) -> set[str]:
    return {path for path, entry in form.entries.items() if entry.widget.native.isVisible()}


def test_every_parameter_has_an_entry(form: ParametersForm) -> None:
    expected = {
        f"{step}.{name}" for step, values in Parameters().model_dump().items() for name in values
    }
    assert set(form.entries) == expected


@pytest.mark.parametrize("name", [None, *PRESETS])
def test_values_come_back_as_they_were_set(form: ParametersForm, name: str | None) -> None:
    parameters = Parameters() if name is None else Parameters.preset(name)
    form.set_values(parameters)
    assert Parameters.from_dict(form.values()) == parameters


def test_optional_numbers_are_empty_or_numbers(form: ParametersForm) -> None:
    depth = form.entries["topography.depth_um"]
    assert depth.value is None
    assert depth.widget.native.placeholderText() == "automatic"
    depth.widget.value = " 1.5 "
    assert Parameters.from_dict(form.values()).topography.depth_um == 1.5
    form.set_values(Parameters())
    assert depth.value is None


def test_texts_and_several_numbers_come_back(form: ParametersForm) -> None:
    given = {
        "psf": 'C:\\psf "1" µm.tif',
        "psf_voxel_um": (0.3, 0.1, 0.1),
        "crop_voxels": (0, 10, 5, 60, 7, 90),
    }
    parameters = Parameters.from_dict({"stack": given})
    form.set_values(parameters)
    assert form.entries["stack.crop_voxels"].value == "0, 10, 5, 60, 7, 90"
    assert Parameters.from_dict(form.values()) == parameters
    form.entries["stack.crop_voxels"].widget.value = "0 10"
    with pytest.raises(ParameterError, match=r"stack\.crop_voxels"):
        Parameters.from_dict(form.values())


def test_directions_and_names_are_typed(form: ParametersForm) -> None:
    axis, field = form.entries["uv.axis_zyx"], form.entries["uv.axis_field"]
    assert axis.value is None
    axis.widget.value, field.widget.value = "1, 0 -2.5", "actin"
    typed = Parameters.from_dict(form.values())
    assert (typed.uv.axis_zyx, typed.uv.axis_field) == ((1.0, 0.0, -2.5), "actin")
    form.set_values(Parameters())
    form.set_values(typed)
    assert Parameters.from_dict(form.values()) == typed
    axis.widget.value = "0, 0, 0"
    with pytest.raises(ParameterError, match=r"uv\.axis_zyx.*length"):
        Parameters.from_dict(form.values())


def test_small_numbers_keep_their_digits(form: ParametersForm) -> None:
    entry = form.entries["reference.threshold"]
    assert float(entry.value) == 1e-5
    entry.widget.value = "3.25e-7"
    assert Parameters.from_dict(form.values()).reference.threshold == 3.25e-7


def test_what_is_no_number_is_named(form: ParametersForm) -> None:
    form.entries["reference.delta"].widget.value = "much"
    with pytest.raises(ParameterError, match=r"reference\.delta"):
        Parameters.from_dict(form.values())


def test_ranges_come_from_the_model(form: ParametersForm) -> None:
    blend = form.entries["sphere.blend"].widget
    assert (blend.min, blend.max) == (0, 1)
    rows = form.entries["uv.rows"].widget
    assert (rows.min, rows.max, rows.step) == (32, 2048, 8)


def test_labels_and_tooltips_carry_unit_meaning_and_source(form: ParametersForm) -> None:
    entry = form.entries["topography.depth_um"]
    assert entry.label == "Depth D_in (µm)"
    assert "inwards from the reference" in entry.widget.tooltip
    assert "Paper: Datasets, D_in = 40 steps." in entry.widget.tooltip
    assert "Default: automatic." in entry.widget.tooltip


def test_main_parameters_first_all_on_request(form: ParametersForm) -> None:
    assert visible(form) == set(MAIN)
    form.show_all(True)
    assert visible(form) == set(form.entries)
    form.hide_entries(["uv.rows"])
    assert visible(form) == set(form.entries) - {"uv.rows"}
    form.show_all(False)
    assert visible(form) == set(MAIN) - {"uv.rows"}


def test_changes_are_told_once(form: ParametersForm, qtbot: object) -> None:
    told: list[int] = []
    form.changed.connect(lambda: told.append(1))
    form.entries["sphere.blend"].widget.value = 0.25
    assert len(told) == 1
    form.set_values(Parameters.preset("ruffles"))
    assert len(told) == 2


def test_the_wheel_scrolls_and_changes_nothing(form: ParametersForm) -> None:
    entry = form.entries["uv.rows"]
    spin = entry.widget.native
    spin.clearFocus()
    wheel = QWheelEvent(
        QPointF(5, 5),
        QPointF(spin.mapToGlobal(QPoint(5, 5))),
        QPoint(0, 0),
        QPoint(0, 120),
        Qt.MouseButton.NoButton,
        Qt.KeyboardModifier.NoModifier,
        Qt.ScrollPhase.NoScrollPhase,
        False,
    )
    QApplication.sendEvent(spin, wheel)
    assert entry.value == 512
