#!/bin/sh
# emulated.sh FOLDER ...: the Python of FOLDER under qemu-user, with this checkout on its path.
set -eu
root=$(cd "$1/root" && pwd)
site=$(cd "$1/site" && pwd)
top=$(cd "$(dirname "$0")/../.." && pwd)
lib=$root/usr/lib/aarch64-linux-gnu
shift
exec qemu-aarch64-static -L "$root" -E PYTHONHOME="$root/usr" -E PYTHONDONTWRITEBYTECODE=1 \
    -E PYTHONPATH="$top:$root/usr/lib/python3/dist-packages:$site" \
    -E LD_LIBRARY_PATH="$lib:$root/lib/aarch64-linux-gnu:$lib/blas:$lib/lapack" "$root/usr/bin/python3.11" "$@"
