#!/usr/bin/env bash
# Start a Ray node that plays the sites of SEARCHLIGHT_SITES, or of /etc/searchlight/site. Arguments go to `ray start`.
set -euo pipefail
here="$(cd "$(dirname "$0")/.." && pwd)"
sites="${SEARCHLIGHT_SITES:-$(cat /etc/searchlight/site)}"
resources=""
for site in $sites; do resources="$resources${resources:+, }\"site:$site\": 1"; done
export RAY_AUTH_MODE="${RAY_AUTH_MODE:-token}" RAY_USAGE_STATS_ENABLED=0
case " $* " in *" --head "*) set -- --include-dashboard=false "$@" ;; esac
exec "$here/.venv/bin/ray" start --resources="{$resources}" "$@"
