#!/usr/bin/env bash
# Make the pictures of the window in docs/pictures by using it, on this display or on a virtual one.
# Arguments go to tools/pictures.py (--help).
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/environment.sh"

# A large window fits on a virtual display whatever the screen is; without one the screen is used.
if [ -z "$(missing_libraries)$(missing_virtual_display)" ] && [ "$(uname)" != Darwin ]; then
  export QT_QPA_PLATFORM=xcb
  exec xvfb-run -a -s "-screen 0 2000x1300x24" "$VENV/bin/python" tools/pictures.py "$@"
fi
has_display || die "The pictures need a display or Xvfb; see what \`make setup\` says is missing."
exec "$VENV/bin/python" tools/pictures.py "$@"
