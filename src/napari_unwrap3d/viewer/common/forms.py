"""Forms made from the parameters' models: titles, units, ranges and tooltips come from there.

A form is a plain widget that holds one magicgui widget per parameter. Nothing here
knows a particular parameter; which ones are shown first is said by the caller.
"""

from __future__ import annotations

import math
import re
import types
from collections.abc import Collection, Iterator
from typing import Any, Literal, Union, get_args, get_origin

from magicgui.widgets import (
    CheckBox,
    ComboBox,
    FloatSlider,
    FloatSpinBox,
    LineEdit,
    Slider,
    SpinBox,
)
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from qtpy.QtCore import QEvent, QObject, Qt, Signal
from qtpy.QtWidgets import QCompleter, QFormLayout, QLabel, QSizePolicy, QWidget

AUTOMATIC = "automatic"
LARGEST = 1_000_000
FIELD_WIDTH = 110
_NUMBERS = re.compile(r"[\s,;×]+")


class WheelGuard(QObject):
    """Keeps the mouse wheel from changing values while the form is scrolled."""

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Pass the wheel on to the scroll area unless the widget has the focus."""
        if event.type() == QEvent.Type.Wheel and not watched.hasFocus():
            event.ignore()
            return True
        return super().eventFilter(watched, event)


class Entry:
    """One parameter of a model with the widget that edits it.

    Attributes
    ----------
    path : str
        ``"step.parameter"``.
    widget : magicgui widget
    """

    def __init__(self, path: str, info: FieldInfo) -> None:
        self.path = path
        self.optional, kind = _without_none(info.annotation)
        self.widget = _widget(kind, info, self.optional)
        self.widget.tooltip = tooltip(info)
        self.label = label(info)
        self.is_text = isinstance(self.widget, LineEdit)
        if self.optional:
            self.widget.native.setPlaceholderText(AUTOMATIC)

    def means(self, value: Any) -> bool:
        """Whether the entry, as it is typed, already stands for this value."""
        if not self.is_text:
            return bool(self.value == value)
        typed = self.value
        if typed is None or value is None or isinstance(value, str):
            return bool(typed == value)
        try:
            return [float(part) for part in _NUMBERS.split(typed.strip(" []()"))] == [
                float(number) for number in (value if isinstance(value, tuple) else (value,))
            ]
        except ValueError:
            return False

    @property
    def value(self) -> Any:
        """As the model takes it: text of numbers is left to the model to read."""
        value = self.widget.value
        if self.is_text:
            value = value.strip()
            return None if self.optional and value == "" else value
        return value

    @value.setter
    def value(self, value: Any) -> None:
        if self.is_text:
            value = _as_text(value)
        self.widget.value = value


class ParametersForm(QWidget):
    """A form for a model whose fields are models, one per step.

    Parameters
    ----------
    defaults : BaseModel
        What Reset goes back to, and whose class says what the form asks.
    main : collection of str
        Paths (``"step.parameter"``) that are always shown; the others appear with
        :meth:`show_all`.
    steps : collection of str, optional
        Only these steps; by default all, each under its heading.
    without : collection of str
        Paths that the form does not ask for.
    """

    changed = Signal()

    def __init__(
        self,
        defaults: BaseModel,
        main: Collection[str],
        parent: QWidget | None = None,
        *,
        steps: Collection[str] | None = None,
        without: Collection[str] = (),
    ) -> None:
        super().__init__(parent)
        self._model = type(defaults)
        self._main = set(main)
        self._hidden: set[str] = set()
        self._all = False
        self.entries: dict[str, Entry] = {}
        self._guard = WheelGuard(self)
        self._headings: dict[str, QLabel] = {}
        self._layout = QFormLayout(self)
        self._layout.setContentsMargins(0, 0, 0, 0)
        self._layout.setVerticalSpacing(3)
        self._layout.setFieldGrowthPolicy(QFormLayout.FieldGrowthPolicy.AllNonFixedFieldsGrow)
        self._layout.setLabelAlignment(Qt.AlignmentFlag.AlignLeft)
        for step, info in self._model.model_fields.items():
            if steps is None or step in steps:
                self._add_step(step, info, without)
        self.set_values(defaults)
        self.show_all(False)

    def _add_step(self, step: str, info: FieldInfo, without: Collection[str]) -> None:
        heading = QLabel(f"<b>{info.title or step}</b>")
        self._headings[step] = heading
        self._layout.addRow(heading)
        for path, field in _fields(step, info):
            if path in without:
                continue
            entry = Entry(path, field)
            title = QLabel(entry.label)
            title.setToolTip(entry.widget.tooltip)
            entry.widget.changed.connect(self._on_changed)
            # Narrower than Qt would have it, so that long names and a scroll bar fit in.
            entry.widget.native.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
            entry.widget.native.setMinimumWidth(FIELD_WIDTH)
            for part in (entry.widget.native, *entry.widget.native.findChildren(QWidget)):
                part.installEventFilter(self._guard)
            self.entries[path] = entry
            self._layout.addRow(title, entry.widget.native)

    def _on_changed(self, _: Any = None) -> None:
        self.changed.emit()

    def values(self) -> dict[str, dict[str, Any]]:
        """The values by step and parameter, as the model takes them."""
        values: dict[str, dict[str, Any]] = {step: {} for step in self._headings}
        for path, entry in self.entries.items():
            step, name = path.split(".")
            values[step][name] = entry.value
        return values

    def set_values(self, parameters: BaseModel) -> None:
        """Show the values of `parameters`; emits `changed` once."""
        self.show_values(parameters)
        self.changed.emit()

    def show_values(self, parameters: BaseModel) -> None:
        """Show the values of `parameters`, which are no change of the user's: no signal.

        What is typed in another way, "1e-5" for 0.00001, stays as it is typed.
        """
        self.blockSignals(True)
        try:
            for path, entry in self.entries.items():
                step, name = path.split(".")
                value = getattr(getattr(parameters, step), name)
                if not entry.means(value):
                    entry.value = value
        finally:
            self.blockSignals(False)

    def show_all(self, show: bool) -> None:
        """Show every parameter under its step's heading, or the main ones only."""
        self._all = show
        self._update_rows()

    def offer(self, path: str, texts: Collection[str]) -> None:
        """Offer texts while one is typed into an entry; other texts stay possible."""
        field = self.entries[path].widget.native
        completer = QCompleter(list(texts), field)
        completer.setCaseSensitivity(Qt.CaseSensitivity.CaseInsensitive)
        completer.setFilterMode(Qt.MatchFlag.MatchContains)
        field.setCompleter(completer)

    def hide_entries(self, paths: Collection[str]) -> None:
        """Take away what makes no sense for the chosen layer; replaces the last choice."""
        self._hidden = set(paths)
        self._update_rows()

    def has_more(self) -> bool:
        """Whether :meth:`show_all` would show anything that is not shown first."""
        return bool(set(self.entries) - self._main - self._hidden)

    def _update_rows(self) -> None:
        shown = set()
        for path, entry in self.entries.items():
            visible = path not in self._hidden and (self._all or path in self._main)
            self._layout.setRowVisible(entry.widget.native, visible)
            if visible:
                shown.add(path.split(".")[0])
        for step, heading in self._headings.items():
            several = len(self._headings) > 1
            self._layout.setRowVisible(heading, several and self._all and step in shown)


def _as_text(value: Any) -> str:
    """Nothing, a text, a number, or several numbers, as they are typed."""
    if value is None or isinstance(value, str):
        return value or ""
    numbers = value if isinstance(value, tuple) else (value,)
    return ", ".join(f"{number:.10g}" for number in numbers)


def label(info: FieldInfo) -> str:
    """Title of a parameter with its unit."""
    unit = _extra(info).get("unit", "")
    return f"{info.title} ({unit})" if unit else str(info.title)


def tooltip(info: FieldInfo) -> str:
    """What a parameter does, its default, and where the paper has it."""
    lines = [info.description or ""]
    default = AUTOMATIC if info.default is None else str(info.default).replace("_", " ")
    lines.append(f"Default: {default}.")
    source = _extra(info).get("source", "")
    if source:
        lines.append(f"Paper: {source}.")
    return "\n".join(lines)


def limits(info: FieldInfo) -> tuple[float | None, float | None, float | None]:
    """Lower and upper limit and multiple of a number, each None where there is none."""
    low: float | None = None
    high: float | None = None
    multiple: float | None = None
    for rule in info.metadata:
        low = _first(rule, ("ge", "gt"), low)
        high = _first(rule, ("le", "lt"), high)
        multiple = _first(rule, ("multiple_of",), multiple)
    return low, high, multiple


def _first(rule: Any, names: tuple[str, ...], otherwise: float | None) -> float | None:
    for name in names:
        value = getattr(rule, name, None)
        if value is not None:
            return float(value)
    return otherwise


def _fields(step: str, info: FieldInfo) -> Iterator[tuple[str, FieldInfo]]:
    model = info.annotation
    assert isinstance(model, type)
    assert issubclass(model, BaseModel)
    for name, field in model.model_fields.items():
        yield f"{step}.{name}", field


def _extra(info: FieldInfo) -> dict[str, Any]:
    extra = info.json_schema_extra
    return dict(extra) if isinstance(extra, dict) else {}


def _without_none(annotation: Any) -> tuple[bool, Any]:
    """Whether None is allowed, and the type without it."""
    if get_origin(annotation) in (Union, types.UnionType):
        kinds = [kind for kind in get_args(annotation) if kind is not type(None)]
        return len(kinds) < len(get_args(annotation)), kinds[0]
    return False, annotation


def _widget(kind: Any, info: FieldInfo, optional: bool) -> Any:
    if get_origin(kind) is Literal:
        choices = [(str(choice).replace("_", " "), choice) for choice in get_args(kind)]
        return ComboBox(choices=choices)
    if kind is bool:
        return CheckBox()
    if optional or kind is str or (kind is float and _spans_decades(info)):
        return LineEdit()
    if kind is int:
        return _integer(info)
    return _number(info)


def _spans_decades(info: FieldInfo) -> bool:
    """A small positive number whose range a slider or spin box cannot resolve."""
    _, high, _ = limits(info)
    default = float(info.default)
    return default > 0 and default < 0.01 * (math.inf if high is None else high)


def _integer(info: FieldInfo) -> Any:
    low, high, multiple = limits(info)
    start = int(low) if low is not None else -LARGEST
    stop = int(high) if high is not None else LARGEST
    step = int(multiple) if multiple is not None else 1
    if stop - start <= 200:
        return Slider(min=start, max=stop, step=step)
    return SpinBox(min=start, max=stop, step=step)


def _number(info: FieldInfo) -> Any:
    low, high, _ = limits(info)
    if low is None or high is None:
        start = -float(LARGEST) if low is None else low
        return FloatSpinBox(min=start, max=float(LARGEST), step=0.1)
    step = 10.0 ** math.floor(math.log10((high - low) / 50))
    return FloatSlider(min=low, max=high, step=step)
