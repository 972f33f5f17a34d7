#!/usr/bin/env bash
# Runs every part of the tests on what `make build` built, goes on after a failure, and ends with a count of the parts.
# Exit status 0 only if all of them passed. Environment: PRESET (release), JOBS (number of processors).
#
#   tests/run.sh [unit] [fuzz] [python] [lint]      all of them by default
set -uo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

preset=${PRESET:-release}
jobs=${JOBS:-$(nproc)}
export FOGBANK_SERVER_BINARY=${FOGBANK_SERVER_BINARY:-$PWD/build/$preset/bin/fogbankd}

unit() { ctest --preset "$preset" --parallel "$jobs"; }
fuzz() {
  cmake --preset fuzz >/dev/null && cmake --build --preset fuzz --parallel "$jobs" &&
    .venv/bin/python tests/fuzz/run.py --jobs "$jobs"
}
python() { .venv/bin/python -m pytest; }
lint() { PRESET=$preset JOBS=$jobs tests/lint.sh; }

passed=0
failed=()
[ $# -gt 0 ] || set -- unit fuzz python lint
for part in "$@"; do
  case $part in
    unit | fuzz | python | lint) ;;
    *) printf "run.sh: error: unknown part '%s'; one of: unit, fuzz, python, lint\n" "$part" >&2; exit 2 ;;
  esac
  printf '\n== %s\n' "$part"
  started=$SECONDS
  if "$part"; then
    passed=$((passed + 1))
  else
    failed+=("$part")
  fi
  printf '== %s took %d s\n' "$part" $((SECONDS - started))
done

printf '\n'
[ ${#failed[@]} -eq 0 ] || printf 'Failed: %s\n' "${failed[*]}"
printf 'parts: %d passed, %d failed\n' "$passed" "${#failed[@]}"
[ ${#failed[@]} -eq 0 ]
