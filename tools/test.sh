#!/usr/bin/env bash
# Run the tests, those of the window on this display or on a virtual one. Arguments go to pytest.
# Without arguments, and where nobody looks on, two processes share the files of tests.
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/environment.sh"

pytest=("$VENV/bin/python" -m pytest "$@")

if has_display; then
  exec "${pytest[@]}"
fi

with_window=true
if [ -n "$(missing_libraries)$(missing_virtual_display)" ]; then
  if [ -n "${CI:-}" ]; then
    die "The tests of the window need a display or Xvfb; see what \`make setup\` says is missing."
  fi
  with_window=false
  pytest+=(--ignore=tests/viewer -p no:pytest-qt -p no:napari)
fi

# Whether there are two cores and the 3 GB that each process may come to take.
has_room_for_two() {
  [ "$(nproc)" -ge 2 ] && awk '/MemAvailable/ { exit !($2 > 6e6) }' /proc/meminfo
}
if [ "$#" = 0 ] && has_room_for_two; then workers=2; else workers=1; fi

servers=()
trap '[ "${#servers[@]}" = 0 ] || kill "${servers[@]}" 2>/dev/null || true' EXIT

# Start a display of its own for one process, as windows take the focus from each other; sets DISPLAY.
# The server itself takes the first number that is free, and says it once it is ready.
open_virtual_display() {
  local number
  exec {said}< <(exec Xvfb -displayfd 1 -screen 0 1600x1200x24 -nolisten tcp 2>/dev/null)
  servers+=("$!")
  read -r -t 60 number <&"$said" || die "Xvfb does not start."
  export DISPLAY=:$number
}

# Qt's offscreen platform draws no OpenGL, so a caller's choice of it does not count here.
if $with_window; then export QT_QPA_PLATFORM=xcb; fi

if [ "$workers" = 1 ]; then
  if $with_window; then open_virtual_display; fi
else
  pytest+=(--dist=loadfile)
  for each in $(seq "$workers"); do
    # Numba's cache is not made for two that write: they may take one name for two versions of a kernel.
    worker=popen//env:NUMBA_CACHE_DIR=$ROOT/.numba_cache/$each
    if $with_window; then
      open_virtual_display
      worker+=//env:DISPLAY=$DISPLAY
    fi
    pytest+=("--tx=$worker")
  done
fi

status=0
"${pytest[@]}" || status=$?
$with_window || warn "Left out: tests/viewer, the tests of the window. \`make setup\` says what they need."
exit $status
