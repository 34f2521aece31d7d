"""People as meshes: a skeleton with joint angles, rounded limbs, and clothes.

Body frame: x to the body's right, y forward, z up; the origin on the ground in the middle of the footprint.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from pipeline.messages import FloatArray
from pipeline.simulation.mesh import Mesh, ellipsoid, limb, linear, merged, rotation_x, rotation_y

_X = np.array([1.0, 0.0, 0.0])


@dataclass(frozen=True)
class Posture:
    """Joint angles, degrees; pairs are left, right.

    rest: upright (on feet or knees), back, prone or side. lean, bend: of pelvis and of chest, forwards.
    hip, knee, shoulder, elbow: flexion. spread, abduction: sideways. cross: forearms inwards.
    point: feet stretched, in line with the shin at 90.
    """

    rest: str = "upright"
    lean: float = 0.0
    bend: float = 0.0
    nod: float = 10.0
    hip: tuple[float, float] = (0.0, 0.0)
    spread: tuple[float, float] = (4.0, 4.0)
    knee: tuple[float, float] = (2.0, 2.0)
    shoulder: tuple[float, float] = (0.0, 0.0)
    abduction: tuple[float, float] = (10.0, 10.0)
    elbow: tuple[float, float] = (12.0, 12.0)
    cross: float = 0.0
    point: float = 0.0


@dataclass(frozen=True)
class Clothes:
    """Colours as #rrggbb. hat, pack: none if empty. short_sleeves, shorts: bare forearms, bare shins."""

    jacket: str
    trousers: str
    shoes: str = "#2b2724"
    skin: str = "#b98a6e"
    hair: str = "#33261c"
    hat: str = ""
    pack: str = ""
    short_sleeves: bool = False
    shorts: bool = False


@dataclass(frozen=True)
class BodyModel:
    """One person to look at. height_m: tall when upright. girth: limb thickness, 1 for an average adult."""

    name: str
    posture: Posture
    clothes: Clothes
    height_m: float = 1.75
    girth: float = 1.0


@dataclass
class _Skeleton:
    """Joints (3,), metres, by name, with the pelvis at the origin."""

    joints: dict[str, FloatArray] = field(default_factory=dict)


def walking(phase_rad: float, stride: float = 1.0) -> Posture:
    """The posture of a walker at a phase of the step cycle (0..2 pi). stride: 1 for a normal step."""
    swing = stride * np.sin(phase_rad)
    lift = stride * np.cos(phase_rad)
    return Posture(
        lean=4.0,
        hip=(25.0 * swing + 4.0, -25.0 * swing + 4.0),
        knee=(8.0 + 34.0 * max(lift, 0.0), 8.0 + 34.0 * max(-lift, 0.0)),
        shoulder=(-24.0 * swing, 24.0 * swing),
        elbow=(22.0, 22.0),
        spread=(1.0, 1.0),
    )


@lru_cache(maxsize=128)
def body_mesh(model: BodyModel, posture: Posture | None = None) -> Mesh:
    """The body in the body frame, resting on z = 0."""
    posture = posture or model.posture
    skeleton = _pose(posture, model.height_m, model.girth)
    mesh = _laid(merged(_parts(skeleton, model)), posture.rest)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    middle = 0.5 * (low + high)
    return mesh.moved(np.eye(3), (-middle[0], -middle[1], -low[2]))


def _laid(mesh: Mesh, rest: str) -> Mesh:
    if rest == "back":
        return mesh.moved(rotation_x(np.pi / 2), (0, 0, 0))
    if rest == "prone":
        return mesh.moved(rotation_x(-np.pi / 2), (0, 0, 0))
    if rest == "side":
        return mesh.moved(rotation_y(np.pi / 2), (0, 0, 0))
    return mesh


def _swung(
    flexion_deg: float, sideways_deg: float, sign: float, up: FloatArray, ahead: FloatArray
) -> FloatArray:
    """Direction of a hanging limb after flexion forwards and a spread to its own side."""
    phi, alpha = np.radians(flexion_deg), np.radians(sideways_deg)
    along = -up * np.cos(phi) + ahead * np.sin(phi)
    return np.asarray(along * np.cos(alpha) + sign * _X * np.sin(alpha))


def _pose(p: Posture, height: float, girth: float) -> _Skeleton:
    s = _Skeleton()
    j = s.joints
    head_share = 0.13 + 0.035 * np.clip((1.6 - height) / 0.6, 0.0, 1.0)
    low = np.radians(p.lean)
    high = np.radians(p.lean + p.bend)
    belly_up = np.array([0.0, np.sin(low), np.cos(low)])
    up = np.array([0.0, np.sin(high), np.cos(high)])
    ahead = np.array([0.0, np.cos(high), -np.sin(high)])
    j["pelvis"] = np.zeros(3)
    j["waist"] = 0.13 * height * belly_up
    j["chest"] = j["waist"] + 0.16 * height * up
    j["neck"] = j["chest"] + 0.045 * height * up
    nod = np.radians(p.lean + p.bend + p.nod)
    crown = np.array([0.0, np.sin(nod), np.cos(nod)])
    j["head"] = j["neck"] + (0.035 + 0.4 * head_share) * height * crown + 0.01 * height * ahead
    j["head_size"] = np.array([0.36 * head_share, 0.44 * head_share, 0.56 * head_share]) * height
    j["crown"], j["ahead"], j["up"] = crown, ahead, up
    for name, sign, i in (("l", -1.0, 0), ("r", 1.0, 1)):
        _arm(j, p, name, sign, i, height, girth)
        _leg(j, p, name, sign, i, height)
    return s


def _arm(
    j: dict[str, FloatArray], p: Posture, name: str, sign: float, i: int, height: float, girth: float
) -> None:
    up, ahead = j["up"], j["ahead"]
    j["shoulder_" + name] = j["chest"] + sign * (0.098 + 0.012 * girth) * height * _X
    upper = _swung(p.shoulder[i], p.abduction[i], sign, up, ahead)
    fore = _swung(p.shoulder[i] + p.elbow[i], p.abduction[i], sign, up, ahead)
    fore = fore - sign * np.sin(np.radians(p.cross)) * _X
    fore = fore / np.linalg.norm(fore)
    j["elbow_" + name] = j["shoulder_" + name] + 0.172 * height * upper
    j["wrist_" + name] = j["elbow_" + name] + 0.15 * height * fore
    j["hand_" + name] = j["wrist_" + name] + 0.055 * height * fore


def _leg(j: dict[str, FloatArray], p: Posture, name: str, sign: float, i: int, height: float) -> None:
    up, ahead = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
    j["hip_" + name] = sign * 0.052 * height * _X - 0.02 * height * up
    thigh = _swung(p.hip[i], p.spread[i], sign, up, ahead)
    shin = _swung(p.hip[i] - p.knee[i], p.spread[i] * 0.6, sign, up, ahead)
    j["knee_" + name] = j["hip_" + name] + 0.245 * height * thigh
    j["ankle_" + name] = j["knee_" + name] + 0.225 * height * shin
    toe = np.cross(shin, _X)
    toe = -toe if toe @ _swung(p.hip[i] - p.knee[i] + 90.0, 0.0, sign, up, ahead) < 0 else toe
    point = np.radians(p.point)
    foot = np.cos(point) * toe + np.sin(point) * shin
    j["toe_" + name] = j["ankle_" + name] + 0.11 * height * foot + 0.022 * height * shin


def _parts(s: _Skeleton, model: BodyModel) -> list[Mesh]:
    wear, h, g = model.clothes, model.height_m, model.girth * model.height_m
    jacket, trousers, skin = linear(wear.jacket), linear(wear.trousers), linear(wear.skin)
    parts = [*_trunk(s.joints, jacket, trousers, h, g), *_head(s.joints, wear, h)]
    for name in ("l", "r"):
        parts += _arm_parts(s.joints, name, jacket, skin if wear.short_sleeves else jacket, skin, g)
        parts += _leg_parts(
            s.joints, name, trousers, skin if wear.shorts else trousers, linear(wear.shoes), g
        )
    if wear.pack:
        parts.append(_pack(s.joints, linear(wear.pack), h))
    return parts


def _trunk(
    j: dict[str, FloatArray], jacket: FloatArray, trousers: FloatArray, h: float, g: float
) -> list[Mesh]:
    return [
        limb(j["pelvis"] - 0.01 * h * j["up"], 0.5 * j["waist"], 0.085 * g, 0.082 * g, trousers, 0.72),
        limb(0.35 * j["waist"], 0.6 * j["waist"] + 0.4 * j["chest"], 0.086 * g, 0.098 * g, jacket, 0.68),
        limb(j["waist"], j["chest"] - 0.02 * h * j["up"], 0.092 * g, 0.104 * g, jacket, 0.66),
        limb(j["shoulder_l"], j["shoulder_r"], 0.046 * g, 0.046 * g, jacket, 1.0, (0.0, 1.0, 0.0)),
    ]


def _head(j: dict[str, FloatArray], wear: Clothes, h: float) -> list[Mesh]:
    crown = j["crown"]
    rotation = np.stack([_X, np.cross(crown, _X), crown], axis=1)
    skin, size, back = linear(wear.skin), j["head_size"], -rotation[:, 1]
    parts = [
        limb(j["neck"] - 0.02 * h * j["up"], j["head"], 0.032 * h, 0.03 * h, skin),
        ellipsoid(j["head"], size, skin, rotation),
        ellipsoid(j["head"] + 0.018 * h * back + 0.012 * h * crown, size * 1.04, linear(wear.hair), rotation),
    ]
    if wear.hat:
        top = j["head"] + 0.022 * h * crown
        parts.append(ellipsoid(top, size * (1.16, 1.16, 0.95), linear(wear.hat), rotation))
    return parts


def _arm_parts(
    j: dict[str, FloatArray], name: str, sleeve: FloatArray, cuff: FloatArray, skin: FloatArray, g: float
) -> list[Mesh]:
    shoulder, elbow, wrist, hand = (j[f"{part}_{name}"] for part in ("shoulder", "elbow", "wrist", "hand"))
    return [
        limb(shoulder, elbow, 0.037 * g, 0.030 * g, sleeve),
        limb(elbow, wrist, 0.029 * g, 0.022 * g, cuff),
        limb(wrist, hand, 0.021 * g, 0.022 * g, skin, 0.7),
    ]


def _leg_parts(
    j: dict[str, FloatArray], name: str, thigh: FloatArray, shin: FloatArray, shoe: FloatArray, g: float
) -> list[Mesh]:
    hip, knee, ankle, toe = (j[f"{part}_{name}"] for part in ("hip", "knee", "ankle", "toe"))
    return [
        limb(hip, knee, 0.058 * g, 0.040 * g, thigh),
        limb(knee, ankle, 0.038 * g, 0.027 * g, shin),
        limb(ankle, toe, 0.027 * g, 0.022 * g, shoe),
    ]


def _pack(j: dict[str, FloatArray], color: FloatArray, h: float) -> Mesh:
    center = 0.3 * j["waist"] + 0.7 * j["chest"] - 0.11 * h * j["ahead"]
    rotation = np.stack([_X, j["ahead"], j["up"]], axis=1)
    return ellipsoid(center, (0.085 * h, 0.065 * h, 0.14 * h), color, rotation)


def footprint_radius(mesh: Mesh) -> float:
    """Greatest horizontal distance of a body's vertex from its reference point, metres."""
    return float(np.hypot(mesh.vertices[:, 0], mesh.vertices[:, 1]).max())
