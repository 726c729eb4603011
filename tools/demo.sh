#!/usr/bin/env bash
# Show the main job on a simulated cell: in a window where there is a display, else as files.
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/environment.sh"

if has_display; then
  set -- --window "$@"
fi
exec "$VENV/bin/napari-unwrap3d" demo "$@"
