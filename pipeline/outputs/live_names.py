"""Names of the files that a run shows of itself, while it flies in a folder of its directory, later beside it."""

from __future__ import annotations

#: that folder, of a run that flies or was cut off
LIVE = "live"
FOUND, POSSIBLE = "salient.geojson", "possible.geojson"
#: only there: what the reducer says of the map so far, what the actors say
REDUCER, STATUS = "reducer.json", "status.json"
