"""Another search area for a mission that flies: what is judged and looked for next follows it, the map stays."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

from pipeline.geo.search_area import load_search_area
from pipeline.logs import ACTOR_LOGS
from pipeline.mission.checks import area_is_on_terrain
from pipeline.mission.live_files import write_ground
from pipeline.mission.prepared import PreparedMission
from pipeline.outputs.live_names import LIVE


def with_search_area(prepared: PreparedMission, area: Path) -> PreparedMission:
    """The mission with the search area of a file, and what was noticed of it in place of what was of the old one.

    Raises InputError for a file that holds none, or for one that lies where no ground is known.
    """
    findings = area_is_on_terrain(area, prepared.terrain)
    before = str(prepared.mission.search_area)
    kept = [finding for finding in prepared.findings if finding.where != before]
    mission = prepared.mission.model_copy(update={"search_area": area})
    return replace(prepared, mission=mission, findings=(*kept, *findings))


class AreaInFlight:
    """The search area that a run has by now. file: of the newest that an operator gave, in the run's logs; or None."""

    def __init__(self, prepared: PreparedMission, run: Path) -> None:
        self._prepared, self._run = prepared, run
        self._said: list[str] = []
        self.file: Path | None = None
        self._count = 0

    def change(self, file: Path) -> str:
        """Take the area of a file, of which a copy is kept; what is to be answered. Raises InputError as above."""
        changed = with_search_area(self._prepared, file)
        area_m2 = load_search_area(file, self._prepared.frame).area_m2
        self._count += 1
        kept = self._run / ACTOR_LOGS / f"search_area-{self._count}{file.suffix}"
        shutil.copyfile(file, kept)
        self._prepared, self.file = with_search_area(changed, kept), kept
        write_ground(self._run / LIVE, self._prepared)
        warned = [f.found for f in self._prepared.findings if f.where == str(kept)]
        self._said.append(". ".join([f"{area_m2:,.0f} m2, {ACTOR_LOGS}/{kept.name}", *warned]))
        return "the search area is now " + self._said[-1]

    def said(self) -> list[str]:
        """What has changed since the last call, for the time line."""
        said, self._said = self._said, []
        return said
