"""Parameters: presets, TOML there and back, and errors that name the key."""

import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from napari_unwrap3d.errors import ParameterError
from napari_unwrap3d.parameters import PRESETS, Parameters
from napari_unwrap3d.pipeline import ON_REQUEST, STEPS

GROUPS = list(Parameters.model_fields)
ALL = [
    (group, name, info)
    for group in GROUPS
    for name, info in type(getattr(Parameters(), group)).model_fields.items()
]


def test_every_parameter_has_a_title_a_description_and_a_unit() -> None:
    for group, name, info in ALL:
        assert info.title, (group, name)
        assert info.description, (group, name)
        assert info.description.endswith("."), (group, name)
        assert set(info.json_schema_extra) == {"unit", "source"}
    units = {name: info.json_schema_extra["unit"] for _, name, info in ALL}
    for name, unit in units.items():
        per_length = name.endswith("_per_um")
        assert not per_length or unit == "1/µm"
        assert per_length or not name.endswith("_um") or unit == "µm"
        assert not name.endswith("_voxels") or unit == "voxels"


def test_every_group_belongs_to_a_step() -> None:
    used = {group for step in (*STEPS, *ON_REQUEST) for group in step.parameters}
    of_movies = {"registration", "movie", "tracking", "boxes", "flow", "measurement"}
    assert used | of_movies == set(GROUPS)


def test_defaults_are_written_and_read_back() -> None:
    text = Parameters().to_toml()
    assert Parameters.from_toml(text) == Parameters()
    assert set(tomllib.loads(text)) == set(GROUPS)


def test_the_text_explains_every_parameter_above_it() -> None:
    lines = Parameters().to_toml().splitlines()
    place = 0
    for group, name, info in ALL:
        header = lines.index(f"[{group}]")
        place = next(
            i
            for i in range(max(header, place + 1), len(lines))
            if lines[i].startswith((f"{name} =", f"# {name} ="))
        )
        assert info.title in lines[place - 1]
        assert info.description in lines[place - 1]
        assert info.json_schema_extra["unit"] in lines[place - 1]
        assert info.json_schema_extra["source"] in lines[place - 1]


values = st.fixed_dictionaries(
    {},
    optional={
        "stack": st.fixed_dictionaries(
            {},
            optional={
                "working_voxel_um": st.floats(1e-6, 1e6),
                "label": st.integers(1, 10**9),
                "fill": st.booleans(),
                "threshold": st.sampled_from(["otsu", "multi-otsu", "value"]),
                "threshold_value": st.floats(-1e9, 1e9),
                "psf": st.text(st.characters(min_codepoint=32, exclude_characters="\x7f")),
                "psf_voxel_um": st.tuples(*[st.floats(1e-6, 1e6)] * 3),
                "crop_voxels": st.tuples(*[st.integers(0, 10**6)] * 6),
                "crop_um": st.tuples(*[st.floats(-1e6, 1e6)] * 6),
            },
        ),
        "sphere": st.fixed_dictionaries(
            {},
            optional={
                "blend": st.floats(0, 1),
                "theta": st.none() | st.floats(0, 1),
                "criterion": st.sampled_from(["equiareal", "q_log_lambda"]),
            },
        ),
        "reference": st.fixed_dictionaries(
            {},
            optional={
                "delta": st.floats(1e-300, 1),
                "flow": st.sampled_from(["cMCF", "MCF"]),
                "laplacian": st.sampled_from(["cotangent", "intrinsic-delaunay", "robust"]),
                "mass": st.sampled_from(["barycentric", "voronoi", "full"]),
                "change_point": st.integers(1, 10),
                "skip": st.booleans(),
                "keep_mesh": st.booleans(),
            },
        ),
        "uv": st.fixed_dictionaries(
            {},
            optional={
                "axis_field": st.text(st.characters(codec="utf-8", exclude_characters="\x7f")),
                "axis_zyx": st.tuples(*[st.floats(-1e9, 1e9)] * 2, st.floats(1e-9, 1e9)),
                "axis_roll_degrees": st.floats(-180, 180),
            },
        ),
        "topography": st.fixed_dictionaries({}, optional={"depth_um": st.floats(0, 1e3)}),
    },
)


@given(given_values=values)
def test_any_valid_values_survive_the_file(given_values: dict, tmp_path_factory) -> None:
    parameters = Parameters.from_dict(given_values)
    assert Parameters.from_toml(parameters.to_toml()) == parameters
    assert Parameters.from_dict(parameters.model_dump()) == parameters


def test_a_path_is_read_and_a_string_is_parsed(tmp_path: Path) -> None:
    file = tmp_path / "parameters.toml"
    file.write_text("# µm\n[uv]\nrows = 64\n", encoding="utf-8")
    assert Parameters.from_toml(file).uv.rows == 64
    assert Parameters.from_toml(file.read_text(encoding="utf-8")).uv.rows == 64


@pytest.mark.parametrize("name", PRESETS)
def test_presets_are_valid_and_survive_the_file(name: str) -> None:
    preset = Parameters.preset(name)
    assert Parameters.from_toml(preset.to_toml()) == preset
    assert preset.reference.iterations == 50
    assert (preset.uv.rows, preset.topography.step_voxels) == (512, 0.5)


def test_presets_have_the_papers_thresholds() -> None:
    threshold = {name: Parameters.preset(name).reference.threshold for name in PRESETS}
    assert (threshold["blebs"], threshold["lamellipodia"]) == (1e-5, 1e-5)
    assert threshold["filopodia"] == 1e-4


def test_an_unknown_preset_names_those_that_exist() -> None:
    with pytest.raises(ParameterError, match=r"'bleb'.*blebs, lamellipodia"):
        Parameters.preset("bleb")


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"uv": {"row": 64}}, r"uv\.row: Extra inputs"),
        ({"sheet": {}}, r"sheet: Extra inputs"),
        ({"uv": {"rows": 100}}, r"uv\.rows: .*multiple of 8.*got 100"),
        ({"uv": {"rows": 16}}, r"uv\.rows: .*32.*got 16"),
        ({"uv": {"rows": "many"}}, r"uv\.rows: .*got 'many'"),
        ({"sphere": {"blend": 1.5}}, r"sphere\.blend: .*got 1\.5"),
        ({"sphere": {"blend": float("nan")}}, r"sphere\.blend"),
        ({"sphere": {"criterion": "q_log_lambda", "theta": 1.5}}, r"sphere: .*at most 1, not 1\.5"),
        ({"sphere": {"criterion": "areas"}}, r"sphere\.criterion.*got 'areas'"),
        ({"reference": {"stop": "soon"}}, r"reference\.stop.*got 'soon'"),
        ({"reference": {"curvature_limit": 1.0}}, r"reference\.curvature_limit"),
        ({"stack": {"working_voxel_um": 0}}, r"stack\.working_voxel_um"),
        ({"topography": {"depth_um": -1}}, r"topography\.depth_um"),
        ({"uv": 3}, r"uv: .*got 3"),
        ({"uv": {"axis_zyx": (0, 0, 0)}}, r"uv\.axis_zyx: .*positive, finite length.* 0 \(got"),
        ({"uv": {"axis_zyx": (1, float("inf"), 0)}}, r"uv\.axis_zyx.*length"),
        ({"uv": {"axis_zyx": "1, up, 0"}}, r"uv\.axis_zyx.*got 'up'"),
        ({"uv": {"axis_zyx": [1, 2]}}, r"uv\.axis_zyx"),
        ({"uv": {"axis_roll_degrees": 200}}, r"uv\.axis_roll_degrees.*180"),
        ({"reference": {"laplacian": "mesh"}}, r"reference\.laplacian.*robust.*got 'mesh'"),
        ({"reference": {"change_point": 0}}, r"reference\.change_point"),
    ],
)
def test_wrong_parameters_are_named(wrong: dict, words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        Parameters.from_dict(wrong)


def test_all_wrong_parameters_are_named_at_once() -> None:
    wrong = {"uv": {"rows": 3}, "sphere": {"blend": 2, "bland": 1}}
    with pytest.raises(ParameterError, match=r"uv\.rows.*sphere\.blend|sphere\.blend.*uv\.rows"):
        Parameters.from_dict(wrong)


def test_text_that_is_no_toml_is_a_parameter_error() -> None:
    with pytest.raises(ParameterError, match="not valid TOML"):
        Parameters.from_toml("[uv\nrows = 64")


def test_parameters_are_frozen() -> None:
    with pytest.raises(ValueError, match="frozen"):
        Parameters().uv.rows = 64


@pytest.mark.parametrize("typed", ["0 1 -2.5", "0, 1, -2.5", [0, 1, -2.5], (0.0, 1.0, -2.5)])
def test_a_direction_is_typed_or_given_as_numbers(typed: object) -> None:
    parameters = Parameters.from_dict({"uv": {"axis_zyx": typed}})
    assert parameters.uv.axis_zyx == (0.0, 1.0, -2.5)
    assert "axis_zyx = [0.0, 1.0, -2.5]" in parameters.to_toml()
