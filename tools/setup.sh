#!/usr/bin/env bash
# Make .venv with everything in it, and see to the system libraries of the window.
# Does nothing when that was done before for this pyproject.toml.
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/environment.sh"

STAMP=$VENV/set-up-for
wanted() { { sha256sum <pyproject.toml 2>/dev/null || shasum -a 256 <pyproject.toml; } | cut -c1-64; say "$ROOT"; }

is_new_enough() { "$1" -c 'import sys; raise SystemExit(sys.version_info < (3, 11))' 2>/dev/null; }

find_python() {
  local candidate
  if [ -n "${PYTHON:-}" ]; then
    is_new_enough "$PYTHON" || die "PYTHON=$PYTHON is not a Python of version 3.11 or later."
    say "$PYTHON"
    return
  fi
  for candidate in python3.11 python3.12 python3.13 python3 /usr/bin/python3; do
    if is_new_enough "$candidate"; then say "$candidate"; return; fi
  done
  die "No Python of version 3.11 or later was found." \
    "Install one (Debian 12: apt-get install python3 python3-venv) or name it: make setup PYTHON=/path/to/python3"
}

can_install_packages() { [ "$(id -u)" = 0 ] && [ -f /etc/debian_version ] && command -v apt-get >/dev/null; }

install_packages() {
  say "Installing system packages: $*"
  export DEBIAN_FRONTEND=noninteractive
  apt-get update -qq </dev/null &&
    apt-get install -y -qq --no-install-recommends "$@" </dev/null >/dev/null
}

make_environment() {
  local python package
  python=$(find_python)
  if ! "$python" -c 'import venv, ensurepip' 2>/dev/null; then
    # Debian keeps the module that makes environments in a package of its own.
    package=$("$python" -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])')
    if ! can_install_packages || ! install_packages "$package"; then
      die "$python cannot make virtual environments. Install: sudo apt-get install $package"
    fi
  fi
  say "Making $VENV with $("$python" -V)"
  "$python" -m venv --clear "$VENV"
}

install_project() {
  say "Installing napari-unwrap3d and what it needs (a few minutes the first time)"
  "$VENV/bin/python" -m pip install --quiet --no-input --disable-pip-version-check -e '.[all,test]'
  wanted >"$STAMP"
}

missing_for_the_window() {
  [ "$(uname)" = Linux ] || return 0
  missing_libraries
  has_display || missing_virtual_display
}

see_to_the_window() {
  local missing
  missing=$(missing_for_the_window)
  if [ -n "$missing" ] && can_install_packages; then
    install_packages "${SYSTEM_PACKAGES[@]}" "${DISPLAY_PACKAGES[@]}" || warn "apt-get failed."
    missing=$(missing_for_the_window)
  fi
  [ -n "$missing" ] || return 0
  warn "Missing on this system, needed for the window and its tests only: ${missing//$'\n'/, }"
  warn "On Debian and Ubuntu: sudo apt-get install ${SYSTEM_PACKAGES[*]} ${DISPLAY_PACKAGES[*]}"
}

exec 9<pyproject.toml # two set-ups at once take turns
command -v flock >/dev/null && flock 9

if [ "$(cat "$STAMP" 2>/dev/null)" != "$(wanted)" ]; then
  # An environment that was moved or whose Python is gone is made anew; else it is brought up to date.
  if [ "$(tail -n 1 "$STAMP" 2>/dev/null)" != "$ROOT" ] || ! is_new_enough "$VENV/bin/python"; then
    make_environment
  fi
  install_project
fi
see_to_the_window
