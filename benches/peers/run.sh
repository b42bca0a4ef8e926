#!/bin/sh
# farfield beside its peers: makes a virtual environment with fmm3dpy, then runs the comparison.
# Arguments go on to the program (--help lists them). Needs python3 and cargo, and PyPI and crates.io
# the first time.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
venv="$here/target/venv"
if [ ! -x "$venv/bin/python" ] || ! "$venv/bin/python" -c 'import fmm3dpy' 2>/dev/null; then
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet 'fmm3dpy==2.1.*' numpy
fi
cd "$here"
PEERS_PYTHON="$venv/bin/python" exec cargo run --release --quiet -- "$@"
