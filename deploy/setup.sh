#!/usr/bin/env bash
# Makes a Debian 12 machine ready to build, test and run Fogbank: Debian packages, then .venv with the locked Python
# packages and this checkout. Does nothing, quickly, when all of it is there. Needs root or sudo only where a
# Debian package is missing.
#
#   deploy/setup.sh            everything
#   deploy/setup.sh packages   Debian packages only
#   deploy/setup.sh python     .venv only
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
readonly root
readonly apt_list=$root/deploy/apt-packages.txt
readonly python_lock=$root/deploy/python-packages.lock
# Debian's interpreter rather than whichever python3 comes first on the PATH: every machine then gets the same one.
readonly python=/usr/bin/python3
readonly uv_version=0.13.8
readonly uv_home=$root/build/uv
readonly venv=$root/.venv

say() { printf 'setup: %s\n' "$*" >&2; }
fail() { say "error: $*"; exit 1; }

as_root() {
  if [ "$(id -u)" -eq 0 ]; then
    "$@"
  elif command -v sudo >/dev/null; then
    sudo --preserve-env=DEBIAN_FRONTEND "$@"
  else
    fail "this needs root: $* (run deploy/setup.sh packages as root once, then again as yourself)"
  fi
}

missing_packages() {
  local wanted present
  wanted=$(sed -e 's/#.*//' -e 's/[[:space:]]//g' -e '/^$/d' "$apt_list" | sort -u)
  # dpkg-query fails if any name is unknown to it; those are then missing from what it prints.
  present=$(dpkg-query --show --showformat='${db:Status-Status} ${Package}\n' $wanted 2>/dev/null |
    sed -n 's/^installed //p' | sort -u) || true
  comm -23 <(printf '%s\n' "$wanted") <(printf '%s\n' "$present")
}

install_packages() {
  command -v dpkg-query >/dev/null || fail "not a Debian machine; install the equivalents of $apt_list yourself"
  local missing
  missing=$(missing_packages)
  [ -n "$missing" ] || return 0
  say "installing Debian packages:" $missing
  export DEBIAN_FRONTEND=noninteractive
  as_root apt-get update --quiet=2
  as_root apt-get install --yes --quiet=2 --no-install-recommends -o Dpkg::Use-Pty=0 $missing
}

install_python() {
  local wanted
  wanted=$(cat "$python_lock" "$root/pyproject.toml" "${BASH_SOURCE[0]}" | sha256sum | cut -d' ' -f1)
  local stamp=$venv/.fogbank-setup
  if [ -x "$venv/bin/python" ] && [ -f "$stamp" ] && [ "$(cat "$stamp")" = "$wanted" ]; then return 0; fi

  if [ "$("$uv_home/bin/uv" --version 2>/dev/null | cut -d' ' -f2)" != "$uv_version" ]; then
    say "installing uv $uv_version into build/uv"
    rm -rf "$uv_home"
    "$python" -m venv "$uv_home"
    "$uv_home/bin/python" -m pip install --quiet --disable-pip-version-check "uv==$uv_version"
  fi
  local uv=$uv_home/bin/uv
  say "installing the locked Python packages into .venv"
  [ -x "$venv/bin/python" ] || "$uv" venv --quiet --clear --python "$python" "$venv"
  "$uv" pip sync --quiet --python "$venv/bin/python" --require-hashes "$python_lock"
  # Everything it needs is installed already, its build back end included, so nothing unlocked can slip in.
  "$uv" pip install --quiet --python "$venv/bin/python" --no-deps --no-build-isolation --editable "$root"
  printf '%s\n' "$wanted" >"$stamp"
}

case "${1:-all}" in
  all)
    install_packages
    install_python
    ;;
  packages) install_packages ;;
  python) install_python ;;
  *) fail "unknown part '$1'; one of: packages, python" ;;
esac
