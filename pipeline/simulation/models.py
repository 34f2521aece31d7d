"""The body models: a drawn one for training, a fixed list for missions, with nothing in common."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.simulation.bodies import BodyModel, Clothes, Posture, walking
from pipeline.simulation.mesh import hex_color
from pipeline.simulation.palette import Palette

_TRAIN_COLORS = [
    "#1f3b73",
    "#b3202c",
    "#e6c229",
    "#2f6b3c",
    "#e8e6e0",
    "#17181b",
    "#6b4a2f",
    "#8a8f98",
    "#e0702a",
    "#5b2a6e",
    "#3f8fb5",
    "#c9a07a",
    "#54603a",
    "#394049",
    "#d46a8c",
    "#7b1e28",
    "#93a86b",
    "#f2efe8",
    "#4a3b2c",
    "#1d5b58",
    "#716b58",
    "#a7b8c9",
]
_TRAIN_TROUSERS = [
    "#22304a",
    "#2b2b2e",
    "#6f6148",
    "#4b5138",
    "#8c8577",
    "#15161a",
    "#3d4f66",
    "#9c8f78",
    "#5a3f2c",
    "#b4b2ab",
    "#36402f",
    "#7f2b2b",
]
_TRAIN_SKIN = ["#e0b49a", "#c68e6c", "#9b6a4a", "#6b4630", "#d6a283", "#4f3323"]
_TRAIN_HAIR = ["#241a12", "#4a3220", "#7d5a34", "#b08a52", "#17130f", "#8b8580"]
_TRAIN_KINDS = (
    "standing",
    "arms_out",
    "waving",
    "sitting",
    "back",
    "prone",
    "side",
    "kneeling",
    "crouching",
    "walking",
)


def random_train_model(rng: np.random.Generator) -> BodyModel:
    """A body model that only training sees."""
    kind = str(rng.choice(_TRAIN_KINDS))
    height = float(rng.choice([rng.uniform(1.15, 1.5), rng.uniform(1.5, 1.95)], p=[0.2, 0.8]))
    return BodyModel(
        kind, random_posture(rng, kind), _random_clothes(rng), height, float(rng.uniform(0.85, 1.25))
    )


def camouflaged(rng: np.random.Generator, model: BodyModel, palette: Palette) -> BodyModel:
    """The same body in the colours of a place's soils and leaves."""
    soils = np.vstack([palette.grass, palette.dirt, palette.gravel, palette.sand, palette.leaves])

    def pick() -> str:
        return hex_color(soils[rng.integers(len(soils))] * rng.uniform(0.6, 1.3))

    wear = model.clothes
    clothes = replace(
        wear, jacket=pick(), trousers=pick(), hat=wear.hat and pick(), pack=wear.pack and pick()
    )
    return replace(model, clothes=clothes)


def random_posture(rng: np.random.Generator, kind: str) -> Posture:  # noqa: PLR0911 - one return for each kind
    """Joint angles of a kind of posture, each time a little different."""

    def pair(low: float, high: float) -> tuple[float, float]:
        return float(rng.uniform(low, high)), float(rng.uniform(low, high))

    def one(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    if kind == "standing":
        return Posture(
            bend=one(-5, 12), hip=pair(-5, 8), shoulder=pair(-12, 35), elbow=pair(5, 90), spread=pair(2, 10)
        )
    if kind == "arms_out":
        return Posture(abduction=pair(65, 105), spread=pair(3, 14), elbow=pair(0, 25))
    if kind == "waving":
        return Posture(
            shoulder=(one(-5, 20), one(130, 175)), abduction=pair(5, 30), elbow=(one(5, 60), one(0, 50))
        )
    if kind == "sitting":
        return Posture(
            lean=one(-20, 12), bend=one(0, 30), hip=pair(65, 105), knee=pair(10, 110),
            spread=pair(2, 22), shoulder=pair(-25, 70), elbow=pair(5, 80), cross=one(0, 40), nod=one(-5, 30),
        )  # fmt: skip
    if kind in ("back", "prone"):
        return Posture(
            rest=kind, nod=0.0, point=one(20, 80), hip=pair(-3, 12), knee=pair(0, 30), spread=pair(2, 25),
            abduction=pair(5, 110), elbow=pair(0, 40), shoulder=pair(-5, 10),
        )  # fmt: skip
    if kind == "side":
        return Posture(
            rest="side", bend=one(0, 35), nod=one(5, 30), hip=pair(20, 95), knee=pair(30, 110),
            shoulder=pair(20, 95), elbow=pair(20, 100), abduction=(one(-5, 10), one(-22, -10)),
            spread=(one(-6, 4), one(2, 6)),
        )  # fmt: skip
    if kind == "kneeling":
        return Posture(
            lean=one(-5, 15), bend=one(0, 25), hip=pair(0, 30), knee=pair(85, 120),
            shoulder=pair(0, 60), elbow=pair(10, 80), spread=pair(2, 12), point=one(60, 90),
        )  # fmt: skip
    if kind == "crouching":
        return Posture(
            lean=one(15, 35), bend=one(10, 35), hip=pair(95, 125), knee=pair(110, 140),
            shoulder=pair(30, 80), elbow=pair(10, 70), spread=pair(4, 18), cross=one(0, 30),
        )  # fmt: skip
    return walking(one(0, 2 * np.pi), one(0.6, 1.3))


def _random_clothes(rng: np.random.Generator) -> Clothes:
    def pick(colors: list[str]) -> str:
        return str(rng.choice(colors))

    return Clothes(
        jacket=pick(_TRAIN_COLORS),
        trousers=pick(_TRAIN_TROUSERS + _TRAIN_COLORS[:6]),
        shoes=pick(["#1b1a19", "#4a3a2a", "#7d7a75", "#d8d5cf"]),
        skin=pick(_TRAIN_SKIN),
        hair=pick(_TRAIN_HAIR),
        hat=pick(_TRAIN_COLORS) if rng.random() < 0.3 else "",
        pack=pick(_TRAIN_COLORS) if rng.random() < 0.25 else "",
        short_sleeves=bool(rng.random() < 0.3),
        shorts=bool(rng.random() < 0.2),
    )


#: what missions show; training never does
MISSION_MODELS: tuple[BodyModel, ...] = (
    BodyModel(
        "sitting woman",
        Posture(lean=-8.0, bend=18.0, hip=(88.0, 80.0), knee=(78.0, 70.0), shoulder=(42.0, 38.0),
                elbow=(40.0, 46.0), cross=22.0, spread=(6.0, 8.0), nod=18.0),
        Clothes("#e3b23c", "#2d3a55", skin="#dbae91", hair="#946d3c"),
        1.64, 0.92,
    ),
    BodyModel(
        "standing hiker",
        Posture(shoulder=(6.0, 18.0), elbow=(20.0, 48.0), hip=(2.0, -4.0), bend=4.0),
        Clothes("#c8372f", "#39424e", skin="#cfa184", hair="#5f4426", pack="#2a6a86"),
        1.79,
    ),
    BodyModel(
        "signalling walker",
        Posture(abduction=(84.0, 92.0), elbow=(6.0, 10.0), spread=(7.0, 7.0)),
        Clothes("#2c7fb0", "#8f8262", skin="#a97452", hair="#1d1713"),
        1.71, 0.95,
    ),
    BodyModel(
        "man on his back",
        Posture(rest="back", nod=0.0, abduction=(38.0, 62.0), spread=(9.0, 14.0), knee=(4.0, 22.0),
                hip=(2.0, 14.0), elbow=(18.0, 8.0), point=35.0),
        Clothes("#dddacd", "#2a3350", skin="#bd8563", hair="#2c2118"),
        1.83, 1.05,
    ),
    BodyModel(
        "curled on the side",
        Posture(rest="side", bend=24.0, nod=20.0, hip=(62.0, 74.0), knee=(82.0, 70.0), shoulder=(58.0, 66.0),
                elbow=(70.0, 58.0), abduction=(4.0, -16.0), spread=(-4.0, 4.0)),
        Clothes("#3d7d4f", "#6d5b46", skin="#8b5b3f", hair="#15110d"),
        1.68,
    ),
    BodyModel(
        "kneeling man",
        Posture(lean=5.0, bend=12.0, hip=(8.0, 12.0), knee=(98.0, 102.0), shoulder=(24.0, 30.0),
                elbow=(44.0, 36.0), spread=(5.0, 6.0), point=82.0),
        Clothes("#d9642f", "#4e4a42", skin="#c99877", hair="#6b6661", hat="#3c5a3a"),
        1.76, 1.12,
    ),
    BodyModel(
        "child",
        Posture(shoulder=(10.0, 150.0), abduction=(14.0, 16.0), elbow=(18.0, 12.0), spread=(5.0, 6.0)),
        Clothes("#c0406e", "#4f6ea3", shoes="#e8e4da", skin="#e2b89d", hair="#a97f48"),
        1.24, 0.95,
    ),
    BodyModel(
        "crouching forager",
        Posture(lean=24.0, bend=22.0, hip=(108.0, 112.0), knee=(124.0, 128.0), shoulder=(52.0, 60.0),
                elbow=(26.0, 30.0), spread=(9.0, 10.0)),
        Clothes("#6f5a3d", "#464d39", skin="#b88a6c", hair="#4c3a28", hat="#7a4b2c"),
        1.73, 1.08,
    ),
    BodyModel(
        "striding man",
        walking(1.1, 1.0),
        Clothes("#44545f", "#232a36", skin="#7a5038", hair="#120f0c", pack="#8d3b2e", short_sleeves=True),
        1.91, 1.0,
    ),
)  # fmt: skip
