#!/usr/bin/env bash
# The tests of the window once more, with the other Qt binding. Arguments go to pytest.
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/environment.sh"

# 6.12.0 drops references to None, which aborts Python before 3.12 (viewer/common/binding.py).
WANTED=(PySide6_Essentials shiboken6)
"$VENV/bin/python" -c 'import sys; sys.exit(sys.version_info >= (3, 12))' &&
  WANTED=('PySide6_Essentials<6.12' 'shiboken6<6.12')

# Beside the environment rather than in it: the binding is chosen by name, not by what is missing.
SITE=$ROOT/.venv-pyside6
if [ "$(cat "$SITE/wanted" 2>/dev/null)" != "${WANTED[*]}" ]; then
  rm -rf "$SITE"
  say "Installing PySide6 into $SITE"
  "$VENV/bin/python" -m pip install --quiet --no-input --disable-pip-version-check \
    --no-deps --target "$SITE" "${WANTED[@]}"
  echo "${WANTED[*]}" >"$SITE/wanted"
fi
export PYTHONPATH=$SITE QT_API=pyside6 PYTEST_QT_API=pyside6
if [ "$#" = 0 ]; then set -- tests/viewer; fi
run=("$VENV/bin/python" -m pytest "$@")
if has_display; then exec "${run[@]}"; fi
export QT_QPA_PLATFORM=xcb
exec xvfb-run -a -s "-screen 0 1600x1200x24" "${run[@]}"
