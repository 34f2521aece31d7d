"""Which layout a model has: by its names, shapes, types, metadata, graph, and a trial picture.

Where two fit equally nobody guesses: the question is an InputError with the ``layout:`` section filled in as
far as could be seen.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pipeline.config.layout import Layout, Rows
from pipeline.detection.class_names import COCO_80, COCO_91, PERSON
from pipeline.detection.facts import Facts
from pipeline.detection.gathering import gather
from pipeline.detection.layout_section import section_of
from pipeline.detection.layouts import proposals
from pipeline.detection.layouts.proposal import Proposal
from pipeline.detection.session import Session
from pipeline.detection.trial import Verdict, try_out
from pipeline.errors import InputError

#: a rival must be so much surer of the person in the trial picture
_SURER = 0.15


@dataclass(frozen=True, slots=True)
class Recognised:
    """name: of the layout. names: of the network's classes, from ``layout.first_class``. why, assumed: said."""

    name: str
    layout: Layout
    facts: Facts
    names: tuple[str, ...]
    why: tuple[str, ...]
    assumed: tuple[str, ...]


class LayoutQuestionError(InputError):
    """A model whose layout is not known; the section to fill in comes with it, line by line."""

    def __init__(self, where: object, found: str, expected: str, section: str = "") -> None:
        super().__init__(where, found, expected)
        self.details = section

    def __reduce__(self) -> tuple[type[LayoutQuestionError], tuple[str, str, str, str]]:  # type: ignore[override]
        return type(self), (self.where, self.found, self.expected, self.details)


def recognise(
    session: Session,
    path: Path,
    *,
    asked: str | Layout | None = None,
    names: tuple[str, ...] | None = None,
    size: tuple[int, int] | None = None,
) -> Recognised:
    """The layout of an open model.

    asked: what the pool says, the name of a layout or a description. names: of the classes, by the pool.
    size: width and height of the input, by the pool, where the model leaves them free.
    Raises InputError for a model that cannot be used, LayoutQuestionError where it is not certain.
    """
    try:
        facts = gather(session, path, names, size)
        if isinstance(asked, Layout):
            described = Proposal(
                "described", asked, ("the pool describes it",), _described_classes(asked, facts)
            )
            return _named(path, described, facts, _possible(path, session, described, facts))
        return _chosen(session, path, facts, asked)
    except LayoutQuestionError:
        raise
    except InputError as error:
        raise (
            error
            if error.where.startswith(str(path))
            else InputError(f"{path}: {error.where}", error.found, error.expected)
        ) from None


def _possible(path: Path, session: Session, proposal: Proposal, facts: Facts) -> Verdict:
    verdict = try_out(session, proposal, facts)
    if verdict.refused is not None:
        raise InputError(f"{path} layout", verdict.refused, "a description that fits the model's outputs")
    return verdict


def _chosen(session: Session, path: Path, facts: Facts, asked: str | None) -> Recognised:
    found = list(proposals(facts))
    if asked is not None:
        named = [p for p in found if p.name == asked]
        if not named:
            others = ", ".join(p.name for p in found) or "none of the built-in ones"
            raise LayoutQuestionError(
                f"{path} layout", repr(asked), f"one that fits its shapes: {others}", section_of(facts, None)
            )
        return _named(path, named[0], facts, _possible(path, session, named[0], facts))
    tried = [(p, try_out(session, p, facts)) for p in found]
    fitting = [(p, v) for p, v in tried if v.refused is None]
    if not fitting:
        reasons = "; ".join(f"not {p.name}, since {v.refused}" for p, v in tried)
        raise LayoutQuestionError(
            path,
            f"a model of no known layout ({facts.signature}{'; ' + reasons if reasons else ''})",
            "one of the known layouts, or this section in the pool, completed:",
            section_of(facts, None),
        )
    fitting = _by_class_count(fitting, facts)
    proposal, verdict = _surest(path, fitting, facts)
    if verdict.doubt is not None:
        raise LayoutQuestionError(
            path,
            f"a model that fits {proposal.name}, but {verdict.doubt} ({facts.signature})",
            f"layout: {proposal.name} in the pool if that is right; rotated boxes are not read",
            section_of(facts, proposal),
        )
    return _named(path, proposal, facts, verdict)


def _by_class_count(fitting: list[tuple[Proposal, Verdict]], facts: Facts) -> list[tuple[Proposal, Verdict]]:
    """Those whose classes are as many as the names, if any are."""
    if facts.names is None:
        return fitting
    same = [(p, v) for p, v in fitting if p.classes in (None, len(facts.names))]
    return same or fitting


def _surest(path: Path, fitting: list[tuple[Proposal, Verdict]], facts: Facts) -> tuple[Proposal, Verdict]:
    """The usual one, or the one that sees the person in the trial picture much better than the rest."""
    ranked = sorted(fitting, key=lambda pv: (-pv[1].person, not pv[0].usual))
    best = ranked[0]
    if best[1].person > 0.0 and all(best[1].person >= v.person + _SURER for p, v in ranked[1:]):
        return best
    usual = [pv for pv in fitting if pv[0].usual] or fitting
    sure = max(v.person for _, v in fitting)
    near = [pv for pv in usual if pv[1].person > sure - _SURER]
    if len(near) == 1:
        return near[0]
    listed = " or ".join(p.name for p, _ in near or usual)
    raise LayoutQuestionError(
        path,
        f"a model that fits several layouts equally, {listed} ({facts.signature})",
        f"layout: with one of these names in the pool, or a section such as this for {(near or usual)[0][0].name}:",
        section_of(facts, (near or usual)[0][0]),
    )


def _named(path: Path, proposal: Proposal, facts: Facts, verdict: Verdict) -> Recognised:
    names, assumed = _names(path, proposal, facts, verdict)
    said = list(proposal.assumed) + assumed
    if facts.size_from.startswith("assumed"):
        said.append(f"an input of {facts.width} x {facts.height}, which the model leaves open")
    if verdict.silent:
        said.append("that it works: its outputs do not depend on the place, with the trial picture at least")
    why = (*proposal.why, *_seen(verdict))
    return Recognised(proposal.name, proposal.layout, facts, names, why, tuple(said))


def _seen(verdict: Verdict) -> tuple[str, ...]:
    if verdict.person:
        return (f"it finds the person in the trial picture with score {verdict.person:.2f}",)
    if verdict.boxes:
        return (f"no box of the {verdict.boxes} in the trial picture fits its person",)
    return ("it finds nothing in the trial picture, which shows a person close by",)


def _names(
    path: Path, proposal: Proposal, facts: Facts, verdict: Verdict
) -> tuple[tuple[str, ...], list[str]]:
    count = proposal.classes or facts.class_count
    first = proposal.layout.first_class
    names = facts.names
    if names is not None:
        if count is not None and len(names) != count:
            raise InputError(
                f"{path} names",
                f"{len(names)} names for {count} classes",
                "one for each class; a head that gives more than boxes and classes is not read"
                " (rotated boxes, masks, poses)",
            )
        return names, []
    if count == len(COCO_80):
        return COCO_80, ["the names of COCO's 80 classes, since it has 80 and says no names"]
    if count == len(COCO_91):
        return COCO_91, ["the names of COCO's classes by their 91 numbers, since it has as many"]
    if count == 1:
        return (PERSON,), ["that its one class is a person, since it says no name"]
    persons = (0,) if first == 0 else (1,)
    if count is None and verdict.label in persons:
        said = (
            f"COCO's names: it calls the person in the trial picture class {verdict.label}, and says no names"
        )
        return (COCO_80 if first == 0 else COCO_91[1:]), [said]
    raise LayoutQuestionError(
        f"{path} names",
        f"a {proposal.name} of {count if count is not None else 'an unknown number of'} classes without names",
        "names: in the pool, its classes in order (or coco, coco91)",
        section_of(facts, proposal) + "\nnames: [?]",
    )


def _described_classes(layout: Layout, facts: Facts) -> int | None:
    shapes = {t.name: t.shape for t in facts.outputs}
    output = layout.output
    if isinstance(output, Rows) and output.tensor in shapes and len(shapes[output.tensor]) == 2:
        values = shapes[output.tensor][1 if output.order == "rows" else 0]
        return int(values or 0) - (5 if output.objectness else 4)
    return None
