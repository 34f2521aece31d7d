"""Which of a network's classes are which layers of the map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pipeline.errors import InputError

PERSON = "person"
_COCO_91 = (
    "background person bicycle car motorcycle airplane bus train truck boat traffic_light fire_hydrant "
    "street_sign stop_sign parking_meter bench bird cat dog horse sheep cow elephant bear zebra giraffe hat "
    "backpack umbrella shoe eye_glasses handbag tie suitcase frisbee skis snowboard sports_ball kite "
    "baseball_bat baseball_glove skateboard surfboard tennis_racket bottle plate wine_glass cup fork knife "
    "spoon bowl banana apple sandwich orange broccoli carrot hot_dog pizza donut cake chair couch "
    "potted_plant bed mirror dining_table window desk toilet door tv laptop mouse remote keyboard cell_phone "
    "microwave oven toaster sink refrigerator blender book clock vase scissors teddy_bear hair_drier "
    "toothbrush"
)
#: numbered as in COCO's annotations, 0 to 90; and the 80 of them that COCO uses, from 0
COCO_91 = tuple(word.replace("_", " ") for word in _COCO_91.split())
_UNUSED = {0, 12, 26, 29, 30, 45, 66, 68, 69, 71, 83}
COCO_80 = tuple(name for number, name in enumerate(COCO_91) if number not in _UNUSED)
#: what people call the classes of theirs that are persons
_PERSONS = frozenset(
    {"person", "persons", "people", "pedestrian", "pedestrians", "human", "humans", "swimmer"}
)


def known_names(names: Sequence[str] | str | None) -> tuple[str, ...] | None:
    """``names`` of a pool: a list, or ``coco`` or ``coco91``."""
    if isinstance(names, str):
        return {"coco": COCO_80, "coco91": COCO_91}[names]
    return None if names is None else tuple(names)


def class_groups(
    names: Sequence[str],
    wanted: Mapping[str, Sequence[str]],
    layers: Mapping[str, int],
    *,
    first: int,
    where: object,
) -> dict[int, tuple[int, ...]]:
    """Of each layer of the map (by its id) that the network knows: the network's classes, by number.

    names: the network's, numbered from ``first``. wanted: the pool's ``classes``; a layer that it lacks is
    the class of that name, for persons also pedestrian, people, human and swimmer. Raises InputError for a
    class that the network does not have, or if it knows none of the layers.
    """
    number_of = {name.lower(): k + first for k, name in reversed(list(enumerate(names)))}
    groups = {}
    for layer, identity in layers.items():
        if layer in wanted:
            for name in wanted[layer]:
                if name.lower() not in number_of:
                    raise InputError(f"{where} classes.{layer}", repr(name), f"one of {_listed(names)}")
            members = [number_of[name.lower()] for name in wanted[layer]]
        else:
            same = _PERSONS if layer == PERSON else {layer.lower()}
            members = [number for name, number in number_of.items() if name in same]
        if members:
            groups[identity] = tuple(sorted(set(members)))
    if not groups:
        found = f"a network that knows {_listed(names)}"
        raise InputError(
            f"{where} classes", found, f"one that knows {' or '.join(layers)}, or which of these it is"
        )
    return groups


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(names[:12])
    return shown if len(names) <= 12 else f"{shown} and {len(names) - 12} more"
