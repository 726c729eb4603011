"""How soon after a click on Run something is seen: progress, and each chart as it is done.

    .venv/bin/python benchmarks/views_first_picture.py

The sample cell (200 voxels) is unwrapped in a window. From a real click on the button to the
first picture of the progress bar, on the clock, other programs included; and from when a chart
is computed to when its layer is in the viewer: before the next-but-one step ends, or, of the
last two steps, before the run does.
"""

from __future__ import annotations

import argparse
from typing import Any

from common import results
from common.children import options_of, run_child
from common.live_run import LIMIT_S, run
from common.results import Bar, Entries
from common.window import on_a_display

from napari_unwrap3d.pipeline import STEP_NAMES

SIZE = 200
PROGRESS, CHARTS = "views/progress-after-click", "views/charts-while-running"
SOON = Bar(200.0, "ms on the clock")
LATE = Bar(0, "charts in the viewer after the next-but-one step")


def entries_of(found: Any) -> Entries:
    """When progress was seen, and how many charts came late."""
    if isinstance(found, str):
        return {PROGRESS: SOON.entry(None, note=found), CHARTS: LATE.entry(None, note=found)}
    seen = {name: 1000 * at for name, at in found["seen"].items()}
    ends, placed = found["ends"], found["placed"]
    delays: dict[str, float] = {}
    late = 0
    for number, step in enumerate(STEP_NAMES):
        chart = "mask" if step == "stack" else step
        at = placed.get(chart, float("inf"))
        delays[chart] = at - ends[step]
        later = STEP_NAMES[number + 2 : number + 3]
        late += at > (ends[later[0]] if later else found["seconds"])
    longest = max(delays, key=lambda chart: delays[chart])
    return {
        PROGRESS: SOON.entry(
            seen.get("bar"),
            first_step_ms=results.significant(seen.get("step"), 3),
            work_ms=results.significant(seen.get("work"), 3),
        ),
        CHARTS: LATE.entry(
            late,
            first_chart_s=results.significant(min(placed.values()), 3),
            run_s=results.significant(found["seconds"], 3),
            longest_delay_s=results.significant(delays[longest], 3),
            longest_delay_of=longest,
        ),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options_of(parser, lambda: run(SIZE))
    on_a_display()
    found = run_child(__file__, limit_s=LIMIT_S)
    entries = entries_of(found)
    results.show(entries)
    if not isinstance(found, str):
        for step, end in found["ends"].items():
            chart = "mask" if step == "stack" else step
            print(f"    {step} done at {end:.2f} s, seen at {found['placed'].get(chart, -1):.2f} s")
    results.merge(entries)


if __name__ == "__main__":
    main()
