#!/usr/bin/env bash
# Start a Ray node that plays the sites of SEARCHLIGHT_SITES, or of /etc/searchlight/site. Arguments go to `ray start`.
#
# Ray's connections are encrypted with the certificates of SEARCHLIGHT_TLS, or of /etc/searchlight/tls (deployments/certificates.sh
# makes them); SEARCHLIGHT_TLS=off: in clear, for machines whose network is safe by itself, such as a VPN.
set -euo pipefail
here="$(cd "$(dirname "$0")/.." && pwd)"
sites="${SEARCHLIGHT_SITES:-$(cat /etc/searchlight/site)}"
resources=""
for site in $sites; do resources="$resources${resources:+, }\"site:$site\": 1"; done
export RAY_AUTH_MODE="${RAY_AUTH_MODE:-token}" RAY_USAGE_STATS_ENABLED=0
# Ray asks cloud providers where it runs, and tells its makers that reports are disabled, by way of a proxy if there is one;
# nobody is at this one (actors/no_calls.py).
unset http_proxy https_proxy all_proxy ALL_PROXY no_proxy NO_PROXY
export HTTP_PROXY=http://127.0.0.1:1 HTTPS_PROXY=http://127.0.0.1:1
# A radio may be away for minutes. By Ray's own numbers (5 checks in a row, 3 s apart, 10 s each) a node is given up within
# about one, and never comes back. Nothing waits for these: who is silent, Searchlight notices within two seconds.
export RAY_health_check_period_ms="${RAY_health_check_period_ms:-5000}"
export RAY_health_check_timeout_ms="${RAY_health_check_timeout_ms:-20000}"
export RAY_health_check_failure_threshold="${RAY_health_check_failure_threshold:-24}"
export RAY_gcs_rpc_server_reconnect_timeout_s="${RAY_gcs_rpc_server_reconnect_timeout_s:-600}"
tls="${SEARCHLIGHT_TLS:-/etc/searchlight/tls}"
if [ "$tls" != off ]; then
  for file in ca.crt node.crt node.key; do
    [ -r "$tls/$file" ] || { echo "error: $tls/$file: found nothing; expected what deployments/certificates.sh makes, or SEARCHLIGHT_TLS=off" >&2; exit 2; }
  done
  openssl x509 -checkend 0 -noout -in "$tls/node.crt" >/dev/null ||
    { echo "error: $tls/node.crt: found a certificate that has expired; expected a new one, by deployments/certificates.sh" >&2; exit 2; }
  export RAY_USE_TLS=1 RAY_TLS_CA_CERT="$tls/ca.crt" RAY_TLS_SERVER_CERT="$tls/node.crt" RAY_TLS_SERVER_KEY="$tls/node.key"
fi
case " $* " in *" --head "*) set -- --include-dashboard=false "$@" ;; esac
exec "$here/.venv/bin/ray" start --resources="{$resources}" "$@"
