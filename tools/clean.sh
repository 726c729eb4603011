#!/usr/bin/env bash
# Remove what the other targets make: environment, caches, builds, the demo's output.
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/environment.sh"

rm -rf .venv .venv-pyside6 build dist demo-output .pytest_cache .mypy_cache .ruff_cache .hypothesis .numba_cache .coverage
find src tests benchmarks tools -name __pycache__ -prune -exec rm -rf {} + 2>/dev/null || true
