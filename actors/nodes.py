"""The nodes of a cluster: work where files are, the program that they run, models that they lack."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

from actors.calls import get
from actors.cluster import cluster
from actors.site import placement
from pipeline.config.inventory import load_inventory
from pipeline.config.mission import load_mission
from pipeline.config.pool import PoolDetector
from pipeline.errors import InputError, SearchlightError, SeveralInputsError
from pipeline.mission.near_files import Near, here
from pipeline.mission.stopping import Stop
from pipeline.storage.code_digest import code_sha256
from pipeline.storage.kept_models import KeptModels, sha256_of

T = TypeVar("T")
#: where a node keeps models that were sent to it; absent: below its user's cache folder
MODELS_VARIABLE = "SEARCHLIGHT_MODELS"
#: a node that is asked which program it runs answers within, seconds: it may have to start Python first
_ANSWER_S = 60.0
_PACKAGES = ("pipeline", "actors")


@contextmanager
def joined(mission: Path, address: str | None, stop: Stop) -> Iterator[Near]:
    """How work is done where a stream's files are. On a cluster it is joined first, and its nodes run this program.

    Raises InputError for a cluster that cannot be joined, a site that nobody plays, a node of another version.
    """
    if address is None:
        yield here
        return
    sites = [site.id for site in load_inventory(load_mission(mission).inventory).sites]
    with cluster(address, sites, stop):
        require_same_program(sites)
        yield at_its_site


def at_its_site(site: str, work: Callable[..., T], *arguments: object) -> T:
    """Near, on a cluster. What a node finds wrong names the site."""
    import ray

    task = ray.remote(work).options(num_cpus=0, resources=placement(site), max_retries=0)
    try:
        result: T = get(task.remote(*arguments), f"site {site}")
        return result
    except SeveralInputsError as error:
        raise SeveralInputsError(tuple(_at(site, fault) for fault in error.faults)) from None
    except InputError as error:
        raise _at(site, error) from None


def _at(site: str, error: InputError) -> InputError:
    return InputError(f"site {site}: {error.where}", error.found, error.expected)


@dataclass(frozen=True)
class Program:
    """What a node runs. code: of its source."""

    version: str
    code: str

    @property
    def words(self) -> str:
        """For an error."""
        return f"Searchlight {self.version} (source {self.code[:12]})"


def program() -> Program:
    """What runs here."""
    return Program(version("searchlight"), code_sha256(*_PACKAGES))


def require_same_program(sites: Iterable[str], ask: Near = at_its_site) -> None:
    """Raises InputError for the first site whose node runs another version than this one."""
    mine = program()
    for site in sites:
        try:
            found = ask(site, program)
        except SearchlightError as error:
            silent = f"a node that cannot say which Searchlight it runs ({error})"
            raise InputError(f"site {site}", silent, mine.words) from None
        if found != mine:
            raise InputError(f"site {site}", found.words, f"{mine.words}, as here")


@dataclass(frozen=True)
class Offer:
    """Models that are sent to a node where it lacks them. sha256: by detector. content: by sha256, Ray's references."""

    sha256: Mapping[str, str] = field(default_factory=dict)
    content: Mapping[str, Any] = field(default_factory=dict)

    def on_this_node(self, detector: PoolDetector) -> PoolDetector:
        """The detector with its model where this node has it."""
        if detector.id not in self.sha256 or detector.model is None:
            return detector
        kept = KeptModels(models_folder(), self._fetched)
        return detector.model_copy(update={"model": kept.path(detector.model, self.sha256[detector.id])})

    def _fetched(self, sha256: str) -> bytes:
        content: bytes = get(self.content[sha256], "the model", None)
        return content


def models_folder() -> Path:
    """Of this node."""
    given = os.environ.get(MODELS_VARIABLE)
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return Path(given) if given else cache / "searchlight/models"


def offered(detectors: Iterable[PoolDetector]) -> Offer:
    """Put the models of a pool where any node can fetch them."""
    import ray

    sha256: dict[str, str] = {}
    content: dict[str, Any] = {}
    for detector in detectors:
        if detector.model is not None:
            sha256[detector.id] = sha256_of(detector.model)
            content.setdefault(sha256[detector.id], ray.put(detector.model.read_bytes()))
    return Offer(sha256, content)
