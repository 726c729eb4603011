"""How long the window is held up during a whole run: the longest gap between two heartbeats.

    .venv/bin/python benchmarks/views_heartbeat.py

A timer beats every 5 ms while a simulated cell of 120 and one of 200 voxels is unwrapped in a
window, after a click on Run, and every chart is placed in it. What counts of a gap is what we
make of it: what the window's thread worked, and what it waited for other threads of ours (for
Python's lock), the latter no longer than these worked meanwhile: on a busy machine they, too,
stand in the queue. Given beside it are the time on the clock, which also counts what drawing the
canvas takes (by software where there is no graphics card) and what other programs and the
computing threads take of the cores (the queue); and the largest of each.
"""

from __future__ import annotations

import argparse
from typing import Any

from common import results
from common.children import options_of, run_child
from common.live_run import LIMIT_S, PARAMETERS, run
from common.results import Bar, Entries
from common.window import on_a_display

BAR = Bar(100.0, "ms, the window's thread at work or waiting for ours, drawing apart")
NAME = "views/heartbeat-{}"
PARTS = ("own", "waiting", "queue", "drawing", "clock")


def entries_of(name: str, found: Any) -> Entries:
    """The longest gap against the bar, and the largest of each part in any gap."""
    if isinstance(found, str):
        return {name: BAR.entry(None, note=found)}
    gaps = found["gaps"]
    largest = {
        f"{part}_ms": results.significant(max(gap[i] for gap in gaps), 3)
        for i, part in enumerate(PARTS)
    }
    return {
        name: BAR.entry(
            max(map(_counted, gaps)),
            longer=sum(_counted(gap) > BAR.limit for gap in gaps),
            beats=len(gaps),
            run_s=results.significant(found["seconds"], 3),
            layers=found["layers"],
            **largest,
        )
    }


def _counted(gap: Any) -> float:
    return float(gap[0] + gap[1])


def show_longest(found: Any) -> None:
    """Print the ten longest gaps by their parts."""
    if isinstance(found, str):
        return
    for *parts, place in sorted(found["gaps"], key=_counted, reverse=True)[:10]:
        told = ", ".join(f"{p} {ms:.0f}" for p, ms in zip(PARTS, parts, strict=True))
        print(f"    {told} ms, after {place or 'nothing'}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, choices=PARAMETERS, help="only this one")
    options = options_of(parser, lambda size: run(int(size)), 1)
    on_a_display()
    for size in [options.size] if options.size else PARAMETERS:
        found = run_child(__file__, str(size), limit_s=LIMIT_S)
        entries = entries_of(NAME.format(size), found)
        results.show(entries)
        show_longest(found)
        results.merge(entries, drop=["views/heartbeat"])


if __name__ == "__main__":
    main()
