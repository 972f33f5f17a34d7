#!/usr/bin/env bash
# Checks form without changing anything: clang-format, clang-tidy, ruff, mypy --strict, buf. Goes on after a failure; exit
# status 0 only if all is clean. Environment: PRESET (release; its compile commands are clang-tidy's), JOBS.
set -uo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

preset=${PRESET:-release}
jobs=${JOBS:-$(nproc)}
bin=.venv/bin
status=0

check() {
  local name=$1
  shift
  if "$@"; then
    printf 'lint: %s: clean\n' "$name"
  else
    printf 'lint: %s: FAILED\n' "$name"
    status=1
  fi
}

mapfile -t cpp < <(git ls-files --cached --others --exclude-standard '*.cpp' '*.h')
mapfile -t python < <(git ls-files --cached --others --exclude-standard '*.py')

# clang-tidy needs seconds a file, so a file is passed over while it, its headers and the rules are what they were when it
# was last found clean (tests/tidy.py).
tidy() { "$bin/python" tests/tidy.py --build "build/$preset" --jobs "$jobs"; }

check clang-format clang-format --dry-run --Werror "${cpp[@]}"
check clang-tidy tidy
check 'ruff check' "$bin/ruff" check --quiet "${python[@]}"
check 'ruff format' "$bin/ruff" format --check --quiet "${python[@]}"
check mypy "$bin/mypy" "${python[@]}"
check buf "$bin/buf" lint proto
exit $status
