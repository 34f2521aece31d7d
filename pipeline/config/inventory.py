"""The machines, where they stand, and the links that reach them."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from pipeline.config.base import Strict, load, mismatch, refuse_repeated
from pipeline.config.units import BitsPerSecond, Bytes
from pipeline.errors import InputError


class Machine(Strict):
    """One CPU or one GPU (a computer with both is two machines, as in the paper)."""

    id: str = Field(pattern=r"^[A-Za-z0-9_.-]+$")
    """Letters, digits, `_`, `.`, `-`. Example: `ground-pc`."""
    type: str
    """The key into the pool's execution times. Example: `workstation`."""
    memory: Bytes
    """For detectors. Example: `{gigabytes: 8}`."""
    count: int = Field(default=1, ge=1, le=10_000)
    """So many equal ones, named ID, ID-2, ID-3, ..."""
    provider: Literal["cpu", "cuda"] = "cpu"
    """What networks run on."""

    @property
    def names(self) -> tuple[str, ...]:
        """ID, ID-2, ID-3, .. up to the count."""
        return self.id, *(f"{self.id}-{number}" for number in range(2, self.count + 1))


class Site(Strict):
    """A place with machines, or a drone that only films: a drone, a ground station, a data centre."""

    id: str = Field(pattern=r"^[A-Za-z0-9_.-]+$")
    """Letters, digits, `_`, `.`, `-`. Example: `ground`."""
    machines: tuple[Machine, ...] = ()
    """What looks at pictures there. Absent: nothing; it only films. Example: `[{id: ground-pc, type: workstation,
    memory: {gigabytes: 8}}]`.
    """


class Link(Strict):
    """How much a stream may send to a site. Without a link it may send nothing."""

    stream: str
    """A stream's id. Example: `drone-1`."""
    site: str
    """A site's id. Example: `ground`."""
    bandwidth: BitsPerSecond
    """`.inf`: without limit, as to the stream's own site. Example: `{mbps: 6}`."""


class Inventory(Strict):
    """The machines, where they stand, and the links that reach them."""

    sites: tuple[Site, ...] = Field(min_length=1)
    """A drone, a ground station, a data centre."""
    links: tuple[Link, ...] = ()
    """Between streams and sites."""
    assumed: tuple[str, ...] = ()
    """What is not measured, in words; repeated by `check` and the report. Example: `[the radio links'
    bandwidths]`.
    """

    @model_validator(mode="after")
    def _names_are_unique(self) -> Inventory:
        refuse_repeated("site", [site.id for site in self.sites], at="sites")
        refuse_repeated("link", [f"{link.stream} -> {link.site}" for link in self.links], at="links")
        self._refuse_repeated_machines()
        if not any(site.machines for site in self.sites):
            raise mismatch("no machine at any site", "one at least, to look at the pictures", ("sites",))
        sites = [site.id for site in self.sites]
        for number, link in enumerate(self.links):
            if link.site not in sites:
                raise mismatch(
                    repr(link.site), "one of the sites " + ", ".join(sites), ("links", number, "site")
                )
        return self

    def _refuse_repeated_machines(self) -> None:
        seen: set[str] = set()
        for s, site in enumerate(self.sites):
            for m, machine in enumerate(site.machines):
                if again := seen.intersection(machine.names):
                    at = ("sites", s, "machines", m, "id")
                    raise mismatch(f"machine {min(again)!r} again", "every machine once", at)
                seen.update(machine.names)


def require_streams(inventory: Inventory, where: Path, streams: Collection[str], of: str) -> None:
    """Raise InputError for a link of a stream that is not there. where: the inventory file. of: whose
    streams.
    """
    for number, link in enumerate(inventory.links):
        if link.stream not in streams:
            raise InputError(
                f"{where} links.{number}.stream",
                repr(link.stream),
                f"a stream of {of}: {', '.join(sorted(streams))}",
            )


def load_inventory(path: Path) -> Inventory:
    """Read and validate an inventory file."""
    return load(path, Inventory)
