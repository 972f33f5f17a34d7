#!/usr/bin/env bash
# Prints the Debian packages that hold the shared libraries a program is linked with, one a line; libraries that these
# need in turn come with the packages' own dependencies.
#
#   deploy/runtime-packages.sh PROGRAM
set -euo pipefail

program=${1:?usage: deploy/runtime-packages.sh PROGRAM}
objdump --private-headers "$program" | awk '$1 == "NEEDED" { print $2 }' | while read -r library; do
  # Debian 12 knows some files by their path below /lib and some by that below /usr/lib: the name decides.
  dpkg-query --search "*/$library" | sed -n 's/:.*//p' | sort -u | head -n 1
done | sort -u
