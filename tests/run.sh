#!/usr/bin/env bash
# Runs every part of the tests on what `make build` built, goes on after a failure, and ends with a count of the parts.
# Exit status 0 only if all of them passed. Environment: PRESET (release), JOBS (number of processors).
#
#   tests/run.sh [unit] [fuzz] [python] [lint]      all of them by default
#
# Python's tests wait for servers, clocks and networks half of the time; lint, which only computes, runs beside them on
# what they leave of the processors (nice 19), and what it says is printed when it is done.
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
# note <part> <exit status> <seconds>
note() {
  if [ "$2" -eq 0 ]; then passed=$((passed + 1)); else failed+=("$1"); fi
  printf '== %s took %d s\n' "$1" "$3"
}
# python_and_lint: both at once; each is noted with its own seconds.
python_and_lint() {
  local folder started=$SECONDS lint_process status
  folder=$(mktemp -d)
  trap 'trap - TERM; kill 0' INT TERM  # what runs in the background ignores Ctrl-C
  (
    renice --priority 19 --pid "$BASHPID" >/dev/null
    lint >"$folder/lint" 2>&1
    status=$?
    printf '%d\n' $((SECONDS - started)) >"$folder/seconds"
    exit "$status"
  ) &
  lint_process=$!
  printf '\n== python\n'
  python
  note python $? $((SECONDS - started))
  wait "$lint_process"
  status=$?
  printf '\n== lint\n'
  cat "$folder/lint"
  note lint "$status" "$(cat "$folder/seconds")"
  trap - INT TERM
  rm -rf "$folder"
}

[ $# -gt 0 ] || set -- unit fuzz python lint
for part in "$@"; do
  case $part in
    unit | fuzz | python | lint) ;;
    *) printf "run.sh: error: unknown part '%s'; one of: unit, fuzz, python, lint\n" "$part" >&2; exit 2 ;;
  esac
done
while [ $# -gt 0 ]; do
  if [ "$1 ${2:-}" = 'python lint' ]; then
    python_and_lint
    shift 2
    continue
  fi
  printf '\n== %s\n' "$1"
  started=$SECONDS
  "$1"
  note "$1" $? $((SECONDS - started))
  shift
done

printf '\n'
[ ${#failed[@]} -eq 0 ] || printf 'Failed: %s\n' "${failed[*]}"
printf 'parts: %d passed, %d failed\n' "$passed" "${#failed[@]}"
[ ${#failed[@]} -eq 0 ]
