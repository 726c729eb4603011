# Sourced by the other scripts: where the project is, a clean environment, and what this machine can show.
# shellcheck shell=bash

cd "$(dirname "${BASH_SOURCE[0]}")/.." || exit 1
ROOT=$PWD
VENV=$ROOT/.venv

# Neither an active environment nor the caller's settings may leak into ours.
unset PYTHONPATH PYTHONHOME PYTHONSTARTUP VIRTUAL_ENV CONDA_PREFIX __PYVENV_LAUNCHER__
unset PIP_TARGET PIP_PREFIX PIP_ROOT PIP_USER PIP_REQUIRE_VIRTUALENV
export PYTHONNOUSERSITE=1

say() { printf '%s\n' "$*"; }
warn() { printf '%s\n' "$*" >&2; }
die() { warn "$@"; exit 1; }

# What Qt and OpenGL need from the system that no wheel brings (Debian's names).
SYSTEM_PACKAGES=(
  libegl1 libgl1 libgl1-mesa-dri libdbus-1-3 libfontconfig1 libfreetype6 libglib2.0-0 libx11-xcb1
  libxkbcommon-x11-0 libxcb-cursor0 libxcb-icccm4 libxcb-image0 libxcb-keysyms1 libxcb-randr0
  libxcb-render-util0 libxcb-shape0 libxcb-xfixes0 libxcb-xkb1
)
# A virtual display for the tests of the window on a machine without a screen.
DISPLAY_PACKAGES=(xvfb xauth)

# Libraries that Qt's X11 plugin asks for and the system does not have, one per line.
missing_libraries() {
  [ "$(uname)" = Linux ] || return 0
  local plugins=("$VENV"/lib/python3*/site-packages/PyQt6/Qt6/plugins/{platforms/libqxcb.so,xcbglintegrations/libqxcb-*.so})
  { ldd "${plugins[@]}" 2>/dev/null || true; } | awk '/not found/ {print $1}' | sort -u
}

# What a virtual display lacks, one per line. Its OpenGL driver is loaded by name, so ldd does not know of it.
missing_virtual_display() {
  command -v xvfb-run >/dev/null || say xvfb-run
  command -v xauth >/dev/null || say xauth
  compgen -G '/usr/lib*/*/dri/*.so' >/dev/null || compgen -G '/usr/lib*/dri/*.so' >/dev/null ||
    compgen -G '/usr/lib*/*/libgallium*.so' >/dev/null || say "Mesa's OpenGL driver"
}

# Whether a window can be opened: a set DISPLAY may belong to a session that is gone.
has_display() {
  [ "$(uname)" = Darwin ] && return 0
  [ -n "${DISPLAY:-}" ] && [ -z "$(missing_libraries)" ] || return 1
  "$VENV/bin/python" - <<'PYTHON'
import ctypes

xcb = ctypes.CDLL("libxcb.so.1")
xcb.xcb_connect.restype = ctypes.c_void_p
xcb.xcb_connection_has_error.argtypes = [ctypes.c_void_p]
raise SystemExit(bool(xcb.xcb_connection_has_error(xcb.xcb_connect(None, None))))
PYTHON
}
