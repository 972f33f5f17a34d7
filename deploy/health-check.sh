#!/usr/bin/env bash
# Asks a server for its health by the standard gRPC health protocol; exit status 0 if it serves. Needs curl only.
#
#   health-check.sh http://127.0.0.1:7071      or https://..., with the CURL_CA_BUNDLE that signed the certificate
set -euo pipefail

target=${1:?usage: health-check.sh http[s]://HOST:PORT}
# A gRPC message is a byte for compression, four for the length, then the message. The request is empty: the whole
# server; the answer's field 1 is 1 if it is serving.
answer=$(printf '\0\0\0\0\0' |
  curl --silent --show-error --fail --http2-prior-knowledge --max-time 5 \
    --header 'content-type: application/grpc' --header 'te: trailers' --data-binary @- \
    "$target/grpc.health.v1.Health/Check" | od -An -tx1 | tr -d ' \n')
if [ "$answer" != 00000000020801 ]; then
  echo "not serving: ${answer:-no answer}" >&2
  exit 1
fi
