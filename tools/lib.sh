# shellcheck shell=bash
# Sourced by the programs in tools/: the repository's root, messages, Debian packages, the virtual environment.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
venv=$root/.venv
cache=${XDG_CACHE_HOME:-${HOME:-/tmp}/.cache}/cylforce

say() { printf '%s: %s\n' "${0##*/}" "$*" >&2; }
# die [STATUS] MESSAGE
die() { local status=1; [ $# = 1 ] || { status=$1; shift; }; say "$@"; exit "$status"; }

# need_debian COMMAND:PACKAGE ... - installs what is missing where it may (root, apt-get), else says what to install.
need_debian() {
  local need missing=()
  for need in "$@"; do
    PATH=$PATH:/usr/sbin:/sbin command -v "${need%%:*}" >/dev/null || missing+=("${need##*:}")
  done
  [ ${#missing[@]} -gt 0 ] || return 0
  if [ "$(id -u)" != 0 ] || ! command -v apt-get >/dev/null; then
    say "missing on this machine: apt-get install --no-install-recommends ${missing[*]} (as root)"
    return 1
  fi
  say "installing Debian packages: ${missing[*]}"
  local log
  log=$(apt-get update 2>&1 && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends "${missing[@]}" 2>&1) ||
    { printf '%s\n' "$log" >&2; say "apt-get could not install ${missing[*]}"; return 1; }
}

find_python() {
  local python
  for python in ${PYTHON:-} python3 python3.14 python3.13 python3.12 python3.11; do
    "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && { echo "$python"; return; }
  done
  die 'needs Python 3.11 or newer (PYTHON=/path/to/python3 chooses one)'
}

# Debian splits ensurepip off into python3-venv; a pip outside can stand in for it.
make_venv() {
  local python
  python=$(find_python)
  if ! "$python" -c 'import ensurepip' 2>/dev/null; then
    if "$python" -m pip --version >/dev/null 2>&1; then
      "$python" -m venv --clear --without-pip "$venv"
      "$python" -m pip --python "$venv/bin/python" install -qq pip
      return
    fi
    need_debian missing-ensurepip:python3-venv || exit 1
  fi
  "$python" -m venv --clear "$venv"
}

# A virtual environment cannot be moved, nor outlive its interpreter.
venv_is_usable() { [ -x "$venv/bin/python" ] && [ -x "$venv/bin/pip" ] && [ "$(cat "$venv/made-for" 2>/dev/null)" = "$root" ]; }

# use_venv [EXTRA] - makes or reuses .venv with the locked dependencies of that extra. The stamp names all that the
# installation depends on, so a second call costs milliseconds; the extra "test" holds all others.
use_venv() {
  local extra=${1:-} stamp known start=$SECONDS
  stamp=$(cat "$root/pyproject.toml" "$root/requirements.lock" <(echo "$root") | sha256sum)
  mkdir -p "$root/.cache"
  exec 9>"$root/.cache/venv.lock"
  flock 9 # two programs started together do not install over each other
  if [ -x "$venv/bin/python" ]; then
    for known in "$extra" test; do
      [ "$(cat "$venv/installed-${known:-base}" 2>/dev/null)" = "$stamp" ] && { activate_venv; return; }
    done
  fi
  say "installing cylforce${extra:+[$extra]} into .venv"
  venv_is_usable || { make_venv; echo "$root" >"$venv/made-for"; }
  # Bytecode is made of what is imported, and not of all that is installed: a quarter of the installation's time.
  local pip=("$venv/bin/python" -m pip install -qq --no-input --no-compile --disable-pip-version-check -c "$root/requirements.lock")
  # Some dependencies come as source only; without isolation their build needs setuptools and wheel here.
  "${pip[@]}" cython hatchling setuptools wheel
  fresh_kernel & # while the dependencies are fetched; the installation's own hook finds it there
  "${pip[@]}" --no-build-isolation -e "$root${extra:+[$extra]}"
  wait $! # whatever came of it: without a compiler the kernel is interpreted
  echo "$stamp" >"$venv/installed-${extra:-base}"
  say "installed in $((SECONDS - start)) s"
  activate_venv
}

# The kernel of a step, compiled from the sources as they are now; without a compiler it is interpreted.
fresh_kernel() {
  local kernel=$root/src/cylforce/estimation/kernel built
  built=$(find "$kernel" -name 'compiled.*.so' | head -n 1)
  [ -n "$built" ] && [ -z "$(find "$kernel" "$root/hatch_build.py" -name '*.py' -newer "$built" -print -quit)" ] && return
  "$venv/bin/python" "$root/hatch_build.py" || say 'the kernel is not compiled (cython and a C compiler are needed): it is interpreted'
}

activate_venv() {
  fresh_kernel
  exec 9>&-
  export VIRTUAL_ENV=$venv PATH=$venv/bin:$PATH
}

# run_module MODULE [ARG ...] - runs a module below tools/ instead of this shell, in the caller's folder. That folder itself
# is searched for no modules. One BLAS thread, as the service has: numpy reads this number when it is imported.
run_module() {
  export PYTHONPATH=$root/tools${PYTHONPATH:+:$PYTHONPATH} PYTHONSAFEPATH=1 OPENBLAS_NUM_THREADS=1
  exec python -m "$@"
}

# The caller's kernel has a vcan0 and it is up.
host_has_vcan() { (($(cat /sys/class/net/vcan0/flags 2>/dev/null || echo 0) & 1)); }

# Path of a ready guest kernel with CAN, unpacked from beside the repository into the cache if need be; fails if there is none.
guest_kernel() {
  local kernel=${VCAN_KERNEL:-$cache/linux-can} packed=${CYLFORCE_SHARED:-$root/../shared}/vcan/linux-can.xz
  if [ ! -x "$kernel" ] && [ -z "${VCAN_KERNEL:-}" ] && [ -r "$packed" ] && command -v xz >/dev/null; then
    mkdir -p "$cache"
    xz -dc "$packed" >"$kernel.$$" && chmod +x "$kernel.$$" && mv "$kernel.$$" "$kernel"
  fi
  [ -x "$kernel" ] && echo "$kernel"
}
