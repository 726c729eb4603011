#!/usr/bin/env bash
# Run the benchmarks and write benchmarks/results.json. Arguments go to the runner.
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/environment.sh"

exec "$VENV/bin/python" benchmarks/run.py "$@"
