"""What the command line shows: progress, tables, errors. Needs rich, nothing else does."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.padding import Padding
from rich.progress import (
    BarColumn,
    TaskID,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.progress import Progress as Bars
from rich.table import Table

from .charts import Stack, Surface
from .errors import Unwrap3DError
from .parameters import Parameters, toml_value
from .quality import KEY_NUMBERS, Row, in_words, worst_mark

SIGNS = {"green": "[green]✔ good[/]", "amber": "[yellow]● fair[/]", "red": "[red]✘ bad[/]", "": ""}


VERDICTS = {
    "green": "[green]All charts are good.[/]",
    "amber": "[yellow]All charts can be used; some are only fair.[/]",
    "red": "[red]Do not rely on what is marked bad.[/]",
}


class StepProgress:
    """A bar per step while a terminal looks on; a line per finished step otherwise.

    An instance is the callback of a :class:`~napari_unwrap3d.progress.Progress`.

    Parameters
    ----------
    console : Console
    estimate : bool
        Also show how long it will still take.
    """

    def __init__(self, console: Console, estimate: bool = False) -> None:
        self.console = console
        self.live = console.is_terminal
        left = (TimeRemainingColumn(),) if estimate else ()
        self._bars = Bars(
            TextColumn("{task.description:<12}"),
            BarColumn(bar_width=28),
            TaskProgressColumn(),
            TimeElapsedColumn(),
            *left,
            TextColumn("[dim]{task.fields[message]}[/]"),
            console=console,
        )
        self._tasks: dict[str, TaskID] = {}
        self._step = ""
        self._started = 0.0

    def __enter__(self) -> StepProgress:
        if self.live:
            self._bars.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            self._finish()
        if self.live:
            self._bars.stop()

    def __call__(self, step: str, fraction: float, message: str = "") -> None:
        """Show that `fraction` of `step` is done."""
        if step != self._step:
            self._finish()
            self._step, self._started = step, time.monotonic()
            if self.live:
                self._tasks[step] = self._bars.add_task(step, total=1.0, message="")
        if self.live:
            self._bars.update(self._tasks[step], completed=fraction, message=escape(message))

    def _finish(self) -> None:
        if not self._step:
            return
        if self.live:
            task = self._tasks[self._step]
            self._bars.update(task, completed=1.0, message="")
            self._bars.stop_task(task)
        else:
            seconds = time.monotonic() - self._started
            self.console.print(f"{self._step:<12} {seconds:6.1f} s", highlight=False)
        self._step = ""


def print_error(console: Console, error: Unwrap3DError | OSError) -> None:
    """What is wrong, the numbers, and the way out, on a line each."""
    if not isinstance(error, Unwrap3DError):
        console.print(f"[bold red]Error:[/] {escape(str(error))}", highlight=False)
        return
    console.print(f"[bold red]Error:[/] {escape(error.what)}", highlight=False)
    for name, value in error.measured.items():
        text = f"{value:.4g}" if isinstance(value, float) else str(value)
        console.print(f"  {escape(name.replace('_', ' '))}: {escape(text)}", highlight=False)
    if error.hint:
        console.print(f"[bold]What to do:[/] {escape(error.hint)}", highlight=False)


def format_value(value: Any) -> str:
    """A number as a person reads it."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}"
    if isinstance(value, float):
        return f"{value:,.0f}" if abs(value) >= 1e5 else f"{value:.4g}"
    return str(value)


def print_quality(console: Console, rows: Sequence[Row], title: str = "Quality") -> None:
    """The judged numbers with their marks, and the reasons of those that are not good."""
    table = Table(title=title, title_justify="left", title_style="bold")
    for name, justify in (("chart", "left"), ("what", "left"), ("value", "right"), ("", "left")):
        table.add_column(name, justify=justify)  # type: ignore[arg-type]
    judged = [row for row in rows if row.mark]
    chart = ""
    for row in rows:
        if not row.mark and (row.chart, row.quantity) not in KEY_NUMBERS:
            continue
        if chart and row.chart != chart:
            table.add_section()
        first, chart = row.chart if row.chart != chart else "", row.chart
        table.add_row(first, escape(row.title), format_value(row.value), SIGNS[row.mark])
    console.print(table)
    for row in judged:
        if row.mark in ("amber", "red"):
            sign = SIGNS[row.mark]
            text = f"{row.chart}, {row.title} {format_value(row.value)}: {row.reason}."
            console.print(f"{sign}  {escape(text)}", highlight=False)
    verdict = VERDICTS.get(worst_mark(judged), "")
    if verdict:
        console.print(verdict, highlight=False)


def print_pairs(console: Console, title: str, pairs: Mapping[str, Any]) -> None:
    """Names and values, a line each."""
    table = Table(title=title, title_justify="left", title_style="bold", show_header=False)
    table.add_column()
    table.add_column()
    for name, value in pairs.items():
        table.add_row(escape(name), escape(format_value(value)))
    console.print(table)


def print_parameters(console: Console) -> None:
    """Every parameter with its default, range, unit and source."""
    for step, group in Parameters.model_fields.items():
        model: Any = group.annotation
        console.rule(f"[bold]{escape(str(model.__doc__).splitlines()[0])}", align="left")
        for name, info in model.model_fields.items():
            extra = info.json_schema_extra or {}
            default = "(empty)" if info.default is None else toml_value(info.default)
            unit = f" {extra['unit']}" if extra.get("unit") else ""
            limits = f"   [dim]{escape(allowed(info))}[/]" if allowed(info) else ""
            source = f" [dim]Paper: {escape(extra['source'])}.[/]" if extra.get("source") else ""
            console.print(
                f"[bold cyan]{step}.{name}[/] = {escape(default)}{unit}{limits}", highlight=False
            )
            text = f"{escape(info.description or info.title)}{source}"
            console.print(Padding(text, (0, 0, 0, 4)), highlight=False)


def allowed(info: Any) -> str:
    """The range or the choices of a field of a pydantic model, in words."""
    choices = [c for c in getattr(info.annotation, "__args__", ()) if isinstance(c, str)]
    if choices:
        return " | ".join(toml_value(choice) for choice in choices)
    if info.annotation is bool:
        return "true | false"
    signs = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤", "multiple_of": "multiple of"}
    limits = [
        f"{sign} {getattr(limit, key):g}"
        for limit in info.metadata
        for key, sign in signs.items()
        if getattr(limit, key, None) is not None
    ]
    return ", ".join(limits)


# What info says --------------------------------------------------------------


def stack_pairs(stack: Stack) -> dict[str, Any]:
    """What a stack is."""
    pairs: dict[str, Any] = {"kind": "stack"}
    pairs |= {f"axis {a}": n for a, n in zip(stack.axes, stack.shape, strict=True)}
    pairs["type"] = str(stack.data.dtype)
    pairs["voxel size (z, y, x)"] = " × ".join(f"{s:g}" for s in stack.voxel_size) + " µm"
    extent = (n * s for n, s in zip(stack.shape[-3:], stack.voxel_size, strict=True))
    pairs["extent (z, y, x)"] = " × ".join(f"{e:.4g}" for e in extent) + " µm"
    if stack.time_step is not None:
        pairs["time step"] = f"{stack.time_step:g} s"
    if stack.channels:
        pairs["channels"] = ", ".join(stack.channels)
    return pairs


def mesh_pairs(surface: Surface) -> dict[str, Any]:
    """What a mesh measures, and what was repaired."""
    pairs: dict[str, Any] = {"kind": "mesh"}
    for name, value in surface.report.items():
        if name not in ("file", "repairs"):
            pairs[in_words(name)] = value
    if surface.fields:
        pairs["fields"] = ", ".join(surface.fields)
    return pairs


def comparison_pairs(found: Mapping[str, Any]) -> dict[str, Any]:
    """How two meshes differ; `found` is that of ``compare_meshes``."""
    floor = format_value(found["sliced_wasserstein_area_noise_floor_um"])
    by_area = format_value(found["sliced_wasserstein_area_um"])
    pairs: dict[str, Any] = {
        "Chamfer distance (µm)": found["chamfer_um"],
        "Hausdorff distance (µm)": found["hausdorff_um"],
        "sliced Wasserstein, vertices (µm)": found["sliced_wasserstein_vertices_um"],
        "sliced Wasserstein, by area (µm)": f"{by_area} (noise floor {floor})",
    }
    for name, sign, power in (("area", "A", 2), ("volume", "V", 3)):
        unit = f"µm{'⁰¹²³'[power]}"
        one, other = found[f"{name}_um{power}"].values()
        pairs[f"{name} ({unit})"] = f"{format_value(one)} and {format_value(other)}"
        ratio, difference = found[f"{name}_difference"], found[f"{name}_difference_um{power}"]
        known = ratio is not None
        text = f"{100 * ratio:+.4g} % ({difference:+.4g} {unit})" if known else format_value(None)
        pairs[f"Δ{sign}"] = text
    return pairs


def project_pairs(summary: Mapping[str, Any]) -> dict[str, Any]:
    """Where a project comes from; `summary` is that of ``read_summary``."""
    provenance = summary["provenance"]
    source = provenance.get("source", {})
    steps = provenance.get("steps", {})
    version = provenance.get("versions", {}).get("napari-unwrap3d", "unknown")
    return {
        "kind": "project",
        "charts": ", ".join(summary["charts"]),
        "source": f"{source.get('name', 'unknown')} ({source.get('kind', 'unknown')})",
        "written by": f"napari-unwrap3d {version}",
        "computed in": f"{sum(step.get('seconds', 0.0) for step in steps.values()):.1f} s",
        "repairs": "; ".join(str(item) for item in provenance.get("repairs", ())) or "none",
    }


def movie_pairs(summary: Mapping[str, Any]) -> dict[str, Any]:
    """What a movie is of; `summary` is that of ``read_movie_summary``."""
    common = summary["common"] or {}
    step, count = float(summary["time_step_s"]), int(summary["timepoints"])
    return {
        "kind": "movie",
        "timepoints": f"{count}, {step:g} s apart, {(count - 1) * step:g} s in all",
        "channels": ", ".join(summary["channels"]) or "none",
        "common space": common.get("method", "not made yet"),
        "why": common.get("recommendation", {}).get("reason", ""),
        "frames made": f"{summary['frames']} of {count}",
        "written by": f"napari-unwrap3d {summary['versions'].get('napari-unwrap3d', 'unknown')}",
    }
