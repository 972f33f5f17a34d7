#!/bin/sh
# Installs what `make test-deploy` needs besides deploy/apt-packages.txt, as root. These are in no list of packages,
# since some would start as services; here nothing is started.
set -eu

missing=
for package in debootstrap munge slurm-client slurmctld slurmd; do
  dpkg-query --show --showformat='${db:Status-Status}' "$package" 2>/dev/null | grep --quiet --line-regexp installed ||
    missing="$missing $package"
done
[ -n "$missing" ] || exit 0
if [ "$(id -u)" -ne 0 ]; then
  echo "make test-deploy needs root, and the packages$missing" >&2
  exit 1
fi
policy=/usr/sbin/policy-rc.d
if [ ! -e "$policy" ]; then
  trap 'rm -f "$policy"' EXIT
  printf '#!/bin/sh\nexit 101\n' >"$policy"
  chmod 755 "$policy"
fi
echo "make test-deploy: installing$missing"
apt-get update --quiet=2
# shellcheck disable=SC2086 # a list
DEBIAN_FRONTEND=noninteractive apt-get install --yes --quiet=2 --no-install-recommends $missing >/dev/null
