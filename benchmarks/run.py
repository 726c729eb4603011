"""Run the benchmarks, and write results.json and the tables of docs/.

    .venv/bin/python benchmarks/run.py                       # all of them, from scratch
    .venv/bin/python benchmarks/run.py core_speed            # the named ones
    .venv/bin/python benchmarks/run.py core_charts --only torus knot
    .venv/bin/python benchmarks/run.py core_charts --missing # go on after an interruption

Every benchmark file is also a command of its own, with the same options.
"""

from __future__ import annotations

import argparse
import subprocess
import sys

from common import results
from tables import write_pages


def main() -> int:
    files = {path.stem: path for path in sorted(results.HERE.glob("*_*.py"))}
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(files)}")
    options, passed_on = parser.parse_known_args()
    if unknown := [name for name in options.names if name.removesuffix(".py") not in files]:
        parser.error(f"no benchmark {', '.join(unknown)}; there are {', '.join(files)}")
    if passed_on and len(options.names) != 1:
        parser.error(f"name the one benchmark that {' '.join(passed_on)} is for")
    if not options.names:
        results.RESULTS.unlink(missing_ok=True)
    failed = []
    for name in options.names or files:
        path = files[name.removesuffix(".py")]
        print(f"== {path.name}", flush=True)
        if subprocess.run([sys.executable, str(path), *passed_on], check=False).returncode:
            failed.append(path.name)
    print("== held bars")
    results.summarise(results.read())
    print(f"== tables written into {', '.join(write_pages()) or 'no page'}")
    for name in failed:
        print(f"{name} ended with an error", file=sys.stderr)
    return len(failed)


if __name__ == "__main__":
    sys.exit(main())
