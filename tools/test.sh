#!/usr/bin/env bash
# Run the tests, those of the window on this display or on a virtual one. Arguments go to pytest.
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/environment.sh"

pytest=("$VENV/bin/python" -m pytest "$@")

if has_display; then
  exec "${pytest[@]}"
fi
if [ -z "$(missing_libraries)$(missing_virtual_display)" ]; then
  # Qt's offscreen platform draws no OpenGL, so a caller's choice of it does not count here.
  export QT_QPA_PLATFORM=xcb
  exec xvfb-run -a -s "-screen 0 1600x1200x24" "${pytest[@]}"
fi
if [ -n "${CI:-}" ]; then
  die "The tests of the window need a display or Xvfb; see what \`make setup\` says is missing."
fi
status=0
"${pytest[@]}" --ignore=tests/viewer -p no:pytest-qt -p no:napari || status=$?
warn "Left out: tests/viewer, the tests of the window. \`make setup\` says what they need."
exit $status
