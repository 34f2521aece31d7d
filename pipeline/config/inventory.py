"""The machines, where they stand, and the links that reach them."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from pipeline.config.base import Strict, load
from pipeline.config.units import BitsPerSecond, Bytes


class Machine(Strict):
    """One CPU or one GPU (a computer with both is two machines, as in the paper).

    type: the key into the pool's execution times. count: so many equal ones, named ID, ID-2, ID-3, ..
    """

    id: str = Field(pattern=r"^[A-Za-z0-9_.-]+$")
    type: str
    memory: Bytes
    count: int = Field(default=1, ge=1)
    provider: Literal["cpu", "cuda"] = "cpu"


class Site(Strict):
    """A place with machines: a drone, a ground station, a data centre."""

    id: str = Field(pattern=r"^[A-Za-z0-9_.-]+$")
    machines: tuple[Machine, ...] = Field(min_length=1)


class Link(Strict):
    """How much a stream may send to a site. No link: 0. ``.inf``: the stream's own site."""

    stream: str
    site: str
    bandwidth: BitsPerSecond


class Inventory(Strict):
    """Sites and links. assumed: what is not measured, in words."""

    sites: tuple[Site, ...] = Field(min_length=1)
    links: tuple[Link, ...] = ()
    assumed: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _names_are_unique(self) -> Inventory:
        _refuse_repeated("site", [site.id for site in self.sites])
        _refuse_repeated("machine", [machine.id for site in self.sites for machine in site.machines])
        _refuse_repeated("link", [f"{link.stream} -> {link.site}" for link in self.links])
        sites = {site.id for site in self.sites}
        for link in self.links:
            if link.site not in sites:
                raise ValueError(f"links that end at a site of the inventory, not at {link.site!r}")
        return self


def _refuse_repeated(kind: str, names: list[str]) -> None:
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"{kind} {name!r} once, not {names.count(name)} times")


def load_inventory(path: Path) -> Inventory:
    """Read and validate an inventory file."""
    return load(path, Inventory)
