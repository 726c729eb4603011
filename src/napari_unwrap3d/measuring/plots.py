"""The plots of measurements: a registry that the window and the reports share (paper, Figs. 4, 5).

>>> kind = PLOTS["lifetimes"]
>>> kind.draw(figure, measurements, selection=(), colours=PAPER, choice="")
>>> kind.numbers(measurements, (), "").to_csv("lifetimes.csv")
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..motion.uv_stacks import field_label
from .plot_kinds import (
    CHOSEN,
    FAINT,
    FONT,
    LINE,
    MARK,
    OTHER,
    PAPER,
    THIRD,
    TRACK_GID,
    PlotKind,
    column_label,
    legend,
    styled,
    track_of,
)

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

    from .measurements import Measurements

    Figures = Figure | SubFigure

__all__ = ["PAPER", "PLOTS", "PlotKind", "column_label", "track_of"]

PICK_POINTS = 4.0
# So many single curves are drawn where nothing is selected; the others are in the mean.
MOST_CURVES = 200
KEYS = ("track_id", "timepoint", "time_s")
NO_EVENT = "The selected tracks have no event."
NOT_DRAWN = (*KEYS, "alive")
OFF_COLOURS = {"": LINE, "on": LINE, "off": OTHER}


# Series --------------------------------------------------------------------------------


def _series_columns(measurements: Measurements) -> tuple[str, ...]:
    return tuple(c for c in measurements.table("series").columns if c not in NOT_DRAWN)


def _chosen(measurements: Measurements, choice: str) -> str:
    names = _series_columns(measurements)
    return choice if choice in names else names[0]


def _series_numbers(
    measurements: Measurements, selection: Collection[int], choice: str
) -> pd.DataFrame:
    table = measurements.table("series")[[*KEYS, _chosen(measurements, choice)]]
    return table[table.track_id.isin(list(selection))] if selection else table


def _draw_series(
    figure: Figures,
    measurements: Measurements,
    selection: Collection[int],
    colours: Mapping[str, str],
    choice: str,
) -> None:
    column = _chosen(measurements, choice)
    table = measurements.table("series")[[*KEYS, column]]
    axes = styled(figure.add_subplot(), colours, "Time (s)", column_label(column))
    groups = dict(iter(table.groupby("track_id")))
    chosen = [track for track in sorted(selection) if track in groups]
    for track in list(groups)[:MOST_CURVES]:
        if track not in chosen:
            # Where some are selected the others stay in sight, so that they can be clicked, too.
            alpha = FAINT / 2 if chosen else FAINT
            _curve(axes, groups[track], column, colours["text"], 0.7, alpha)
    for number, track in enumerate(chosen):
        _curve(axes, groups[track], column, CHOSEN[number % len(CHOSEN)], 1.6, 1.0)
        events = measurements.table("events")
        times = events.loc[events.track_id == track, "time_s"].to_numpy()
        own = groups[track].set_index("time_s")[column]
        axes.plot(times, own.reindex(times).to_numpy(), "v", color=MARK, markersize=4)
    if not chosen:
        mean = table.groupby("time_s")[column].mean()
        axes.plot(mean.index, mean.to_numpy(), color=LINE, linewidth=1.6, label="mean of all")
    legend(axes, colours)


def _curve(
    axes: Axes, table: pd.DataFrame, column: str, colour: str, width: float, alpha: float
) -> None:
    track = int(table.track_id.iloc[0])
    (line,) = axes.plot(
        table.time_s, table[column], color=colour, linewidth=width, alpha=alpha, picker=PICK_POINTS
    )
    line.set_gid(f"{TRACK_GID}{track}")
    if alpha == 1.0:
        line.set_label(f"track {track}")


def _no_series(measurements: Measurements) -> str:
    return "" if len(measurements.table("series")) else "No track was measured."


# Events --------------------------------------------------------------------------------


def _aligned_columns(measurements: Measurements) -> list[list[str]]:
    """What is drawn into one pair of axes: the area, and every field on and off protrusions."""
    there = set(measurements.table("mean_event").get("column", ()))
    groups = [["area_um2"]]
    for name in measurements.fields:
        sides = [f"on_{name}", f"off_{name}"]
        groups.append(sides if there.issuperset(sides) else [name])
    return [[c for c in group if c in there] for group in groups if there.intersection(group)]


def _mean_event(measurements: Measurements, selection: Collection[int]) -> pd.DataFrame:
    """The mean course of all events, or of those of the selected tracks."""
    if not selection:
        return measurements.table("mean_event")
    from .tables import mean_event_table

    aligned = measurements.table("aligned")
    return mean_event_table(aligned[aligned.track_id.isin(list(selection))])


def _aligned_numbers(
    measurements: Measurements, selection: Collection[int], choice: str
) -> pd.DataFrame:
    table = _mean_event(measurements, selection)
    drawn = [c for group in _aligned_columns(measurements) for c in group]
    return table[table["column"].isin([choice] if choice else drawn)]


def _draw_aligned(
    figure: Figures,
    measurements: Measurements,
    selection: Collection[int],
    colours: Mapping[str, str],
    choice: str,
) -> None:
    table = _mean_event(measurements, selection)
    groups = [[choice]] if choice else _aligned_columns(measurements)
    all_axes = np.atleast_1d(figure.subplots(len(groups), 1, sharex=True))
    for axes, names in zip(all_axes, groups, strict=True):
        for name in names:
            side = name.split("_")[0] if len(names) > 1 else ""
            own = table[table["column"] == name]
            _band(axes, own.time_s, own["mean"], own["sem"], OFF_COLOURS[side], side)
        label = names[0].removeprefix("on_") if len(names) > 1 else names[0]
        styled(axes, colours, "", column_label(label))
        axes.axvline(0.0, color=colours["secondary"], linewidth=0.8, linestyle="--")
        legend(axes, colours)
    count = int(table["count"].max()) if len(table) else 0
    if not count:
        all_axes[0].set_title(NO_EVENT, fontsize=FONT, color=colours["text"], loc="left")
    all_axes[-1].set_xlabel(f"Time from the peak (s), {count} events, mean ± s.e.m.")


def _band(axes: Axes, x: Any, mean: Any, half: Any, colour: str, label: str) -> None:
    axes.plot(x, mean, color=colour, linewidth=1.5, label=label or None)
    axes.fill_between(x, mean - half, mean + half, color=colour, alpha=0.25, linewidth=0)


def _aligned_choices(measurements: Measurements) -> tuple[str, ...]:
    return tuple(dict.fromkeys(measurements.table("mean_event").get("column", ())))


def _no_events(measurements: Measurements) -> str:
    if len(measurements.table("events")):
        return ""
    least = measurements.parameters.measurement.prominence
    return f"No event stands out by {least:g} or more; a smaller prominence finds more."


# Histograms ----------------------------------------------------------------------------


def _draw_lifetimes(
    figure: Figures,
    measurements: Measurements,
    selection: Collection[int],
    colours: Mapping[str, str],
    choice: str,
) -> None:
    table = measurements.table("lifetimes")
    axes = styled(figure.add_subplot(), colours, "Lifetime (s)", "Tracks")
    _bars(axes, table, "s")
    mean = float(measurements.numbers["mean_lifetime_s"])
    axes.axvline(mean, color=MARK, linestyle="--", linewidth=1.2, label=f"mean {mean:.1f} s")
    lifetimes = dict(zip(measurements.tracks.ids, measurements.tracks.lifetimes_s(), strict=True))
    _rug(axes, lifetimes, selection)
    legend(axes, colours)


def _draw_speeds(
    figure: Figures,
    measurements: Measurements,
    selection: Collection[int],
    colours: Mapping[str, str],
    choice: str,
) -> None:
    numbers = measurements.numbers
    axes = styled(figure.add_subplot(), colours, numbers["speed_label"], "Tracks")
    _bars(axes, measurements.table("speeds"), "um_per_min")
    for name, style in (("slow", ":"), ("fast", "--")):
        speed = numbers.get(f"{name}_um_per_min")
        if speed is not None:
            label = f"{name} {speed:.2f} µm/min"
            axes.axvline(speed, color=MARK, linestyle=style, linewidth=1.2, label=label)
    tracks = measurements.table("tracks")
    _rug(axes, dict(zip(tracks.track_id, tracks[numbers["speed_column"]], strict=True)), selection)
    legend(axes, colours)


def _bars(axes: Axes, table: pd.DataFrame, unit: str) -> None:
    left, right = table[f"from_{unit}"].to_numpy(), table[f"to_{unit}"].to_numpy()
    axes.bar(left, table.tracks, right - left, align="edge", color=LINE, alpha=0.7, linewidth=0)


def _rug(axes: Axes, values: Mapping[Any, float], selection: Collection[int]) -> None:
    """Where the selected tracks are in a histogram."""
    for number, track in enumerate(sorted(selection)):
        if track in values and np.isfinite(values[track]):
            colour = CHOSEN[number % len(CHOSEN)]
            (mark,) = axes.plot([values[track]], [0.0], "^", color=colour, markersize=7)
            mark.set_clip_on(False)
            mark.set_picker(PICK_POINTS)
            mark.set_gid(f"{TRACK_GID}{track}")


# Correlations --------------------------------------------------------------------------


def _draw_autocorrelation(
    figure: Figures,
    measurements: Measurements,
    selection: Collection[int],
    colours: Mapping[str, str],
    choice: str,
) -> None:
    axes = styled(figure.add_subplot(), colours, "Lag (s)", "Autocorrelation, mean ± s.d.")
    table = measurements.table("autocorrelation")
    names = [choice] if choice else list(dict.fromkeys(table["field"]))
    for name, colour in zip(names, (LINE, OTHER, THIRD) * len(names), strict=False):
        own = table[table["field"] == name]
        _band(axes, own.lag_s, own["mean"], own["std"], colour, field_label(name))
        lobe = measurements.numbers.get("side_lobe_s", {}).get(name)
        if lobe is not None:
            axes.axvline(lobe, color=colour, linestyle="--", linewidth=1)
    axes.axhline(0.0, color=colours["secondary"], linewidth=0.8)
    legend(axes, colours)


def _autocorrelation_choices(measurements: Measurements) -> tuple[str, ...]:
    return tuple(dict.fromkeys(measurements.table("autocorrelation").get("field", ())))


def _autocorrelation_numbers(
    measurements: Measurements, selection: Collection[int], choice: str
) -> pd.DataFrame:
    table = measurements.table("autocorrelation")
    return table[table["field"] == choice] if choice else table


def _draw_cross_correlation(
    figure: Figures,
    measurements: Measurements,
    selection: Collection[int],
    colours: Mapping[str, str],
    choice: str,
) -> None:
    one, other = (field_label(name) for name in measurements.correlated)
    axes = styled(figure.add_subplot(), colours, "Lag (s)", "Cross-correlation, mean and 95 % CI")
    table = measurements.table("cross_correlation")
    axes.plot(table.lag_s, table["mean"], color=LINE, linewidth=1.5)
    axes.fill_between(table.lag_s, table["low"], table["high"], color=LINE, alpha=0.25, linewidth=0)
    curves = measurements.table("track_correlation")
    for number, track in enumerate(sorted(selection)):
        own = curves[curves.track_id == track]
        if len(own):
            own = own.assign(time_s=own.lag_s)
            _curve(axes, own, "correlation", CHOSEN[number % len(CHOSEN)], 1.2, 1.0)
    axes.axhline(0.0, color=colours["secondary"], linewidth=0.8)
    axes.axvline(0.0, color=colours["secondary"], linewidth=0.8, linestyle="--")
    # Where few tracks reach, the interval of a mean is wider than any correlation.
    axes.set_ylim(-1.05, 1.05)
    title = f"{one} and {other}; lag > 0: the second follows"
    styled(axes, colours, "Lag (s)", "Cross-correlation, mean and 95 % CI", title)
    legend(axes, colours)


def _cross_correlation_numbers(
    measurements: Measurements, selection: Collection[int], choice: str
) -> pd.DataFrame:
    if not selection:
        return measurements.table("cross_correlation")
    table = measurements.table("track_correlation")
    return table[table.track_id.isin(list(selection))]


def _no_pair(measurements: Measurements) -> str:
    if len(measurements.table("cross_correlation")):
        return ""
    return "There are no two fields to correlate; a movie with a signal has them."


def _draw_relationship(
    figure: Figures,
    measurements: Measurements,
    selection: Collection[int],
    colours: Mapping[str, str],
    choice: str,
) -> None:
    name = measurements.correlated[0]
    label = f"Mean over the track: {field_label(name)}"
    axes = styled(figure.add_subplot(), colours, label, "Correlation at lag 0")
    density = measurements.table("density").pivot(
        index="correlation", columns=name, values="density"
    )
    x, y = density.columns.to_numpy(float), density.index.to_numpy(float)
    _filled(axes, x, y, density.to_numpy(), colours["text"])
    table = measurements.table("relationship")
    _band(axes, table[name], table["mean"], table["std"], LINE, "mean ± s.d.")
    tracks = measurements.table("tracks").set_index("track_id")
    for number, track in enumerate(sorted(selection)):
        if track in tracks.index:
            place = tracks.loc[track, [f"series_{name}", "correlation"]].to_numpy(float)
            (mark,) = axes.plot(
                *place[:, None], "o", color=CHOSEN[number % len(CHOSEN)], picker=PICK_POINTS
            )
            mark.set_gid(f"{TRACK_GID}{track}")
    axes.axhline(0.0, color=colours["secondary"], linewidth=0.8)
    axes.set_xlim(x.min(), x.max())
    axes.set_ylim(-1, 1)
    legend(axes, colours)


def _filled(axes: Axes, x: Any, y: Any, density: Any, colour: str) -> None:
    """A density in one colour, the stronger the more there is, and clear where there is nothing."""
    from matplotlib.colors import to_rgba

    levels = float(density.max()) * np.linspace(0.05, 1.0, 9)
    shades = [to_rgba(colour, alpha) for alpha in np.linspace(0.08, 0.55, len(levels) - 1)]
    axes.contourf(x, y, density, levels=levels, colors=shades)


# The registry --------------------------------------------------------------------------


def _table(name: str) -> Any:
    def numbers(measurements: Measurements, selection: Collection[int], choice: str) -> Any:
        return measurements.table(name)

    return numbers


def _needs(name: str, why: str) -> Any:
    def missing(measurements: Measurements) -> str:
        return "" if len(measurements.table(name)) else why

    return missing


def _one_thing(measurements: Measurements) -> tuple[str, ...]:
    return ()


PLOTS: dict[str, PlotKind] = {
    "series": PlotKind(
        "Series",
        "A value at the place of every track over time; triangles are events.",
        _draw_series,
        _series_numbers,
        _series_columns,
        _no_series,
    ),
    "aligned": PlotKind(
        "Mean event",
        "All events laid over each other at their peaks, mean ± s.e.m. (paper, Fig. 4f).",
        _draw_aligned,
        _aligned_numbers,
        _aligned_choices,
        _no_events,
    ),
    "lifetimes": PlotKind(
        "Lifetimes",
        "How long tracks last (paper, Fig. 4d).",
        _draw_lifetimes,
        _table("lifetimes"),
        _one_thing,
        _needs("lifetimes", "There is no track."),
    ),
    "autocorrelation": PlotKind(
        "Autocorrelation",
        "How long fields stay alike at places of the surface; a side lobe is a period "
        "(paper, Fig. 4e).",
        _draw_autocorrelation,
        _autocorrelation_numbers,
        _autocorrelation_choices,
        _needs("autocorrelation", "The movie is too short for an autocorrelation."),
    ),
    "speeds": PlotKind(
        "Speeds",
        "How fast tracks move on average; lines are the thresholds of three classes by Otsu's "
        "method, the paper's estimates of two populations (Fig. 5d).",
        _draw_speeds,
        _table("speeds"),
        _one_thing,
        _needs("speeds", "No track lasts for two timepoints."),
    ),
    "cross_correlation": PlotKind(
        "Cross-correlation",
        "Two fields along every track at a range of lags (paper, Fig. 5e).",
        _draw_cross_correlation,
        _cross_correlation_numbers,
        _one_thing,
        _no_pair,
    ),
    "relationship": PlotKind(
        "Correlation and curvature",
        "How the correlation at lag 0 depends on the mean of the first field along the track "
        "(paper, Fig. 5e).",
        _draw_relationship,
        _table("relationship"),
        _one_thing,
        _needs("relationship", "There are too few tracks with a correlation for a density."),
    ),
}
