"""Tables of a movie over time: how the cell has moved, and how well it fits the common space."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from .common import EACH

if TYPE_CHECKING:
    import pandas as pd

    from .movie import Movie

COMPARED = ("residual_before", "residual", "corresponding")
CHECKED = (
    "area_um2",
    "volume_um3",
    "outside_area_um2",
    "outside_fraction",
    "empty_area_um2",
    "empty_fraction",
)


def registration_table(movie: Movie) -> pd.DataFrame:
    """As :meth:`Movie.registration_table`."""
    import pandas as pd

    rows = []
    for timepoint, time_s in enumerate(movie.times_s):
        found = movie.folder.registered(timepoint)
        numbers = {} if found is None else found.numbers
        row = {"timepoint": timepoint, "time_s": time_s, **_moved(numbers)}
        row |= {name: numbers.get(name, np.nan) for name in COMPARED}
        for channel, own in numbers.get("channels", {}).items():
            name = movie.channels[int(channel)]
            row |= {f"{key}_{name}": value for key, value in _moved(own).items()}
        rows.append(row)
    return pd.DataFrame(rows)


def check_table(movie: Movie) -> pd.DataFrame:
    """As :meth:`Movie.check_table`."""
    import pandas as pd

    rows = []
    for timepoint, time_s in enumerate(movie.times_s):
        made = movie.has_frame(timepoint)
        numbers = movie.folder.frame_numbers(timepoint) if made else {}
        row = {"timepoint": timepoint, "time_s": time_s, "made": made}
        rows.append(row | {name: numbers.get(name, np.nan) for name in CHECKED})
    return pd.DataFrame(rows)


def proposal(movie: Movie) -> str:
    """As :meth:`Movie.proposal`."""
    limit = movie.parameters.movie.largest_outside
    if movie.record.get("method") == EACH:
        return ""
    table = movie.check_table().fillna(0.0)
    shares = table[["outside_fraction", "empty_fraction"]].max(axis=1)
    if not (shares > limit).any():
        return ""
    worst = table.loc[shares.idxmax()]
    return (
        f"At timepoint {worst.timepoint:.0f}, {100 * worst.outside_fraction:.1f} % of the "
        f"surface ({worst.outside_area_um2:.1f} µm²) leaves the common space, and over "
        f"{100 * worst.empty_fraction:.1f} % of the reference there is no surface; at "
        f"{int((shares > limit).sum())} of {len(movie)} timepoints it is more than "
        f"{100 * limit:g} %. An atlas for each timepoint holds all of it "
        '(movie.common = "each").'
    )


def _moved(numbers: Mapping[str, Any]) -> dict[str, float]:
    """The columns of a motion in a table."""
    z, y, x = numbers.get("shift_um", (np.nan,) * 3)
    return {
        "shift_z_um": z,
        "shift_y_um": y,
        "shift_x_um": x,
        "shift_um": float(np.linalg.norm((z, y, x))),
        "angle_deg": numbers.get("angle_deg", np.nan),
    }
