#!/usr/bin/env bash
# Style, types and napari's manifest. Says everything that is wrong, not only the first kind.
set -uo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/environment.sh"

status=0
check() { say "$*"; "$VENV/bin/$@" || status=1; }

check ruff check .
check ruff format --check .
check mypy
check npe2 validate src/napari_unwrap3d/napari.yaml
exit $status
