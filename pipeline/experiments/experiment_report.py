"""What an experiment found, beside the paper's figure: as JSON, pictures and one HTML page."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from matplotlib.figure import Figure

from pipeline.outputs.html import page_environment
from pipeline.outputs.map_picture import png
from pipeline.storage.whole_or_nothing import write_bytes, write_text


@dataclass(frozen=True)
class Measure:
    """One figure. paper: the paper's, as text. wanted: at least or at most limit; None: nothing."""

    name: str
    ours: float
    unit: str
    paper: str
    wanted: Literal["<=", ">="] | None = None
    limit: float = math.nan

    @property
    def met(self) -> bool | None:
        """Whether the figure is reached; None if nothing is asked."""
        if self.wanted is None:
            return None
        return self.ours <= self.limit if self.wanted == "<=" else self.ours >= self.limit


@dataclass(frozen=True, eq=False)
class Experiment:
    """pictures: by name, which is the file's and the caption's. parameters: what was chosen, and why."""

    number: int
    title: str
    text: str
    measures: Sequence[Measure]
    pictures: Mapping[str, Figure]
    parameters: Mapping[str, str] = field(default_factory=dict)


def write_experiment(out: Path, experiment: Experiment) -> None:
    """Write report.html, PICTURE.png and, last, results.json into a folder that exists."""
    pictures = {name: png(figure) for name, figure in experiment.pictures.items()}
    for name, data in pictures.items():
        write_bytes(out / f"{name}.png", data)
    template = page_environment("pipeline.experiments").get_template("experiment.html.j2")
    page = template.render(experiment=experiment, pictures=pictures)
    write_text(out / "report.html", page)
    write_text(out / "results.json", json.dumps(results(experiment), indent=1, allow_nan=False) + "\n")


def results(experiment: Experiment) -> dict[str, Any]:
    """The experiment as plain values."""
    return {
        "experiment": experiment.number,
        "title": experiment.title,
        "measures": [
            {
                "name": m.name,
                "ours": round(m.ours, 4) if math.isfinite(m.ours) else None,
                "unit": m.unit,
                "paper": m.paper,
                "wanted": None if m.wanted is None else f"{m.wanted} {m.limit:g}",
                "met": m.met,
            }
            for m in experiment.measures
        ],
        "parameters": dict(experiment.parameters),
    }
