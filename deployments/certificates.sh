#!/usr/bin/env bash
# Certificates for Ray's own connections: deployments/certificates.sh FOLDER ADDRESS..
#
# Makes FOLDER/ca (keep ca.key off the machines) and FOLDER/ADDRESS for each machine: ca.crt, node.crt and node.key, which belong into
# /etc/searchlight/tls there. Run again for more machines, or for one whose key is to be changed: remove its folder first.
# SEARCHLIGHT_TLS_DAYS: how long they are good, 90 unless it is said.
set -euo pipefail
[ $# -ge 2 ] || { echo "usage: $0 FOLDER ADDRESS.. (such as: $0 tls 10.0.0.1 10.0.0.11)" >&2; exit 2; }
folder="$1" days="${SEARCHLIGHT_TLS_DAYS:-90}"
shift
[[ "$days" =~ ^[1-9][0-9]*$ ]] || { echo "error: SEARCHLIGHT_TLS_DAYS: found $days; expected a number of days above 0" >&2; exit 2; }
umask 077
mkdir -p "$folder/ca"
if [ ! -e "$folder/ca/ca.key" ]; then
  openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days "$days" -subj "/CN=Searchlight" \
    -addext "basicConstraints=critical,CA:TRUE" -addext "keyUsage=critical,keyCertSign,cRLSign" \
    -keyout "$folder/ca/ca.key" -out "$folder/ca/ca.crt" 2>/dev/null
fi
for address in "$@"; do
  own="$folder/$address"
  [ ! -e "$own/node.key" ] || { echo "$own: is there already" >&2; continue; }
  mkdir -p "$own"
  # a node speaks with itself over loopback too
  printf 'subjectAltName=IP:%s,IP:127.0.0.1,DNS:localhost\nextendedKeyUsage=serverAuth,clientAuth\n' "$address" >"$own/names"
  openssl req -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -subj "/CN=$address" \
    -keyout "$own/node.key" -out "$own/request" 2>/dev/null
  openssl x509 -req -in "$own/request" -CA "$folder/ca/ca.crt" -CAkey "$folder/ca/ca.key" -CAcreateserial -days "$days" \
    -extfile "$own/names" -out "$own/node.crt" 2>/dev/null
  cp "$folder/ca/ca.crt" "$own/ca.crt"
  rm "$own/request" "$own/names"
done
