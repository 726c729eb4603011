"""Errors say what is wrong, the measured number and the way out."""

import inspect

import pytest

from napari_unwrap3d import errors
from napari_unwrap3d.errors import (
    Cancelled,
    ChartMissingError,
    InputError,
    MeshError,
    NotGenusZeroError,
    Unwrap3DError,
)

OURS = [
    kind
    for _, kind in inspect.getmembers(errors, inspect.isclass)
    if kind.__module__ == errors.__name__
]


def test_the_message_has_three_parts() -> None:
    error = NotGenusZeroError("It has handles.", genus=3, volume=1.23456789, hint="Seal it.")
    assert str(error) == "It has handles. Measured: genus = 3, volume = 1.235. Seal it."
    assert error.what == "It has handles."
    assert error.hint == "Seal it."
    assert error.measured == {"genus": 3, "volume": 1.23456789}


def test_parts_that_are_not_given_leave_no_trace() -> None:
    assert str(MeshError("Broken.")) == "Broken."
    assert str(MeshError("Broken.", hint="Repair it.")) == "Broken. Repair it."
    assert str(Cancelled()) == "Cancelled."
    assert str(MeshError("Broken.", faces=0)) == "Broken. Measured: faces = 0."


@pytest.mark.parametrize("kind", OURS, ids=lambda kind: kind.__name__)
def test_all_have_one_base_and_a_docstring(kind: type[Unwrap3DError]) -> None:
    assert issubclass(kind, Unwrap3DError)
    assert kind.__doc__
    with pytest.raises(Unwrap3DError, match="Measured: count = 2"):
        raise kind(count=2)


def test_each_is_also_what_python_would_raise() -> None:
    assert issubclass(InputError, ValueError)
    assert issubclass(ChartMissingError, LookupError)
    assert not issubclass(Cancelled, ValueError)
