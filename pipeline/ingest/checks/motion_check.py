"""Whether the pictures move as the telemetry says, and if not, which single fault of the telemetry explains it.

Each kind of fault is one number (a clock offset, a turn, a height, a focal length) or a switch (the sign of the pitch,
another stream's telemetry). For each kind the number is found that fits the measured motion best. A fault is reported
where the telemetry as it is does not fit, and named where one kind alone fits well; kinds that fit alike are named
together, since these pictures cannot tell them apart.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.ingest.checks.picture_motion import Motion
from pipeline.ingest.checks.predicted_motion import Assumption, Predictor
from pipeline.ingest.finding import Finding
from pipeline.messages import FloatArray


@dataclass(frozen=True)
class MotionCheckParams:
    """noise_px, noise_share, noise_rad: of a displacement, of its length and in angle: what terrain, compression,
    matching and the trembling of a gimbal and of a satellite fix add (one deviation).

    most_misfit: of telemetry that is right, see ``misfit_of``. most_strength, most_clock_strength: of a fault in
    telemetry that is right, see ``strength``; a clock fits by chance more easily than the other kinds. Each of the
    three is passed by one right stream in a thousand; docs/checks.md says from which flights that follows.
    least_misfit: what remains is taken to be at least this, however exact a telemetry is. most_bursts: that count;
    with more, the small errors of right telemetry would be found. alike: kinds whose strengths differ by no more
    cannot be told apart. least_motion_px: of the median patch; with less there is nothing to compare. least_patches:
    that must be found again. least_share: of the bursts that must have poses. least_focal_motion: squared, in
    deviations, by which a focal length that is 15 % longer must change the motion, or this tells nothing of it: an
    orbit about what is looked at has 0.1 at most, other flights 0.5 at least.
    """

    noise_px: float = 0.3
    noise_share: float = 0.06
    noise_rad: float = 0.0045
    most_misfit: float = 2.1
    most_strength: float = 12.8
    most_clock_strength: float = 30.4
    least_misfit: float = 0.4
    most_bursts: int = 16
    alike: float = 10.0
    least_motion_px: float = 1.0
    least_patches: int = 24
    least_share: float = 0.6
    least_focal_motion: float = 0.25


@dataclass(frozen=True, slots=True)
class Fit:
    """The best value of one kind of fault. misfit: with it."""

    cause: str
    value: float
    misfit: float


@dataclass(frozen=True, slots=True)
class Other:
    """Another stream: here, this video's motion by its telemetry; there, its video's motion by this telemetry."""

    here: Predictor
    there: Predictor


def deviations_px(measured_px: FloatArray, focal_px: float, params: MotionCheckParams) -> FloatArray:
    """(M,): one deviation of what a displacement (M, 2) may be off. focal_px: in pixels that were compared."""
    return params.noise_px + params.noise_share * np.hypot(*measured_px.T) + params.noise_rad * focal_px


def burst_misfits(
    measured_px: FloatArray, predicted_px: FloatArray, burst: NDArray[np.int64], sd_px: FloatArray
) -> FloatArray:
    """Of each burst with patches, by its number, the mean squared residual (M, 2) in deviations, each at most 16.

    A patch that should not be in sight (infinite) counts 16. NaN for a burst without a pose.
    """
    squared = np.minimum(((measured_px - predicted_px) ** 2).sum(axis=1) / sd_px**2, _MOST)
    counts = np.bincount(burst)
    return np.asarray(np.bincount(burst, squared)[counts > 0] / counts[counts > 0])


def misfits_of(predictor: Predictor, assumed: Assumption, params: MotionCheckParams) -> FloatArray:
    """Of each burst, see ``burst_misfits``; their mean is about 0.4 to 0.8 if the telemetry is right."""
    measured = predictor.motion.displacement_px
    sd_px = deviations_px(measured, predictor.focal_px, params)
    return burst_misfits(measured, predictor.displacement_px(assumed), predictor.motion.burst, sd_px)


def misfit_of(
    predictor: Predictor,
    assumed: Assumption,
    params: MotionCheckParams,
    as_it_is: FloatArray | None = None,
) -> float:
    """The mean over the bursts. as_it_is: misfits of the bursts that the assumption leaves without a pose.

    Without it these do not count, but where fewer than least_share of the bursts have a pose, the misfit is 16.
    """
    misfits = misfits_of(predictor, assumed, params)
    if as_it_is is not None:
        misfits = np.where(np.isnan(misfits), as_it_is, misfits)
    known = misfits[~np.isnan(misfits)]
    return float(known.mean()) if len(known) >= max(1.0, params.least_share * len(misfits)) else _MOST


def strength(bursts: int, before: float, after: float, params: MotionCheckParams) -> float:
    """How much a fault explains: a likelihood ratio, with the misfit that remains as the noise of a burst."""
    return min(bursts, params.most_bursts) * (before - after) / max(after, params.least_misfit)


#: kind -> the values that are tried first, and what they mean
_GRIDS: Mapping[str, tuple[Sequence[float], Callable[[float], Assumption]]] = {
    "clock_off": (np.arange(-6.0, 6.01, 0.3).tolist(), lambda v: Assumption(clock_s=v)),
    "heading_off": (np.radians(np.arange(-180.0, 180.0, 15.0)).tolist(), lambda v: Assumption(yaw_rad=v)),
    "height_off": (np.arange(-60.0, 60.1, 4.0).tolist(), lambda v: Assumption(height_m=v)),
    "focal_length": (np.geomspace(0.5, 2.0, 17).tolist(), lambda v: Assumption(focal_scale=v)),
    "pitch_sign": ([-1.0], lambda v: Assumption(pitch_sign=v)),
}
#: a squared residual counts no more
_MOST = 16.0
#: steps in which a value is refined, as shares of the grid's step
_REFINED = (0.5, 0.25, 0.125, 0.0625)


def check_motion(
    where: str,
    own: Predictor,
    others: Mapping[str, Other],
    params: MotionCheckParams | None = None,
) -> list[Finding]:
    """At most one finding. others: the other streams, by name."""
    params = params or MotionCheckParams()
    motion = own.motion
    measured = motion.displacement_px
    speed_px = float(np.median(np.hypot(*measured.T))) if len(measured) else 0.0
    if not shows_motion(motion, params):
        text = f"its motion was not compared with the telemetry: {len(measured)} patches, moving {speed_px:.1f} pixels"
        return [
            Finding("assumed", "motion_unseen", where, text, "a hovering drone, or pictures without texture")
        ]
    bursts = len(np.unique(motion.burst))
    as_it_is, of_bursts = misfit_of(own, Assumption(), params), misfits_of(own, Assumption(), params)
    if as_it_is <= params.most_misfit and strength(bursts, as_it_is, 0.0, params) <= params.most_strength:
        return []  # whatever explained all of it
    kinds = [kind for kind in _GRIDS if kind != "focal_length" or _tells_focal_length(own, params)]
    found = [_best(kind, lambda a: misfit_of(own, a, params, of_bursts)) for kind in kinds]
    found += _exchanged(others, params)
    found.sort(key=lambda fit: fit.misfit)
    strong = [f for f in found if strength(bursts, as_it_is, f.misfit, params) > _most(f.cause, params)]
    if as_it_is <= params.most_misfit and not strong:
        return []
    best = strong[0] if strong else found[0]
    explained = strength(bursts, as_it_is, best.misfit, params)
    evidence = (
        f"{len(measured)} patches in {bursts} moments move {speed_px:.1f} pixels; their misfit to the "
        f"telemetry is {as_it_is:.2f} (at most {params.most_misfit:g} where it is right), and {_words(best)} would "
        f"explain {explained:.0f} (at most {_most(best.cause, params):g})"
    )
    if own.is_still:
        text = "the drone does not move by its telemetry, and the pictures do"
        return [Finding("warning", "frozen", where, text, evidence, "telemetry.file: a recording with a fix")]
    if best.misfit > params.most_misfit or not strong:
        text = "the pictures do not move as the telemetry says, and no single fault explains it: another flight's?"
        mend = "telemetry.file: the one of this video"
        proof = f"{evidence}; {_words(best)} leaves {best.misfit:.2f}"
        return [Finding("warning", "other_flight", where, text, proof, mend)]
    alike = [fit for fit in strong if strength(bursts, fit.misfit, best.misfit, params) <= params.alike]
    alike = _told_apart(alike, best)
    causes = "/".join(fit.cause.split(" ")[0] for fit in alike)
    text = "the pictures do not move as the telemetry says; they would with " + ", or with ".join(
        map(_words, alike)
    )
    proof = evidence + "; with it " + ", ".join(f"{fit.misfit:.2f}" for fit in alike)
    return [Finding("warning", causes, where, text, proof, " or ".join(_mend(fit) for fit in alike))]


def shows_motion(motion: Motion, params: MotionCheckParams) -> bool:
    """Whether there is enough in the pictures to compare."""
    measured = motion.displacement_px
    if len(measured) < params.least_patches:
        return False
    return float(np.median(np.hypot(*measured.T))) >= params.least_motion_px


def _tells_focal_length(own: Predictor, params: MotionCheckParams) -> bool:
    """Whether the flight moves the ground through the pictures otherwise with another focal length."""
    longer, usual = (own.displacement_px(Assumption(focal_scale=scale)) for scale in (1.15, 1.0))
    sd_px = deviations_px(own.motion.displacement_px, own.focal_px, params)
    with np.errstate(invalid="ignore"):  # where both see no ground
        changes = burst_misfits(longer, usual, own.motion.burst, sd_px)
    known = changes[~np.isnan(changes)]
    return bool(len(known)) and float(known.mean()) >= params.least_focal_motion


def _most(cause: str, params: MotionCheckParams) -> float:
    return params.most_clock_strength if cause == "clock_off" else params.most_strength


def _exchanged(others: Mapping[str, Other], params: MotionCheckParams) -> list[Fit]:
    """Streams whose telemetry fits this video; where their video shows motion, this telemetry must fit that."""
    found = []
    for name, other in others.items():
        fit = misfit_of(other.here, Assumption(), params)
        if fit > params.most_misfit:
            continue
        seen = shows_motion(other.there.motion, params)
        if not seen or misfit_of(other.there, Assumption(), params) <= params.most_misfit:
            found.append(Fit(f"exchanged with {name}", 0.0, fit))
    return found


def _told_apart(alike: list[Fit], best: Fit) -> list[Fit]:
    """Height and focal length stand together where both fit; of the others only the best counts as well."""
    scale = {"height_off", "focal_length"}
    if best.cause in scale:
        return [fit for fit in alike if fit.cause in scale]
    return alike[:2]


def _best(cause: str, fits: Callable[[Assumption], float]) -> Fit:
    grid, meaning = _GRIDS[cause]
    scored = [(fits(meaning(value)), value) for value in grid]
    score, value = min(scored)
    if len(grid) == 1:
        return Fit(cause, value, score)
    step = grid[1] - grid[0]
    for share in _REFINED:
        near = [value - share * step, value + share * step]
        score, value = min([(score, value), *((fits(meaning(v)), v) for v in near)])
    return Fit(cause, value, score)


def _words(fit: Fit) -> str:
    if fit.cause == "clock_off":
        return f"telemetry {abs(fit.value):.2f} s {'earlier' if fit.value > 0 else 'later'}"
    if fit.cause == "heading_off":
        return f"every yaw turned by {math.degrees(fit.value):+.0f} degrees"
    if fit.cause == "height_off":
        return f"every height {fit.value:+.1f} m"
    if fit.cause == "focal_length":
        return f"a focal length {100.0 * (fit.value - 1.0):+.0f} %"
    if fit.cause == "pitch_sign":
        return "the sign of the pitch changed"
    return "the telemetry of " + fit.cause.removeprefix("exchanged with ")


def _mend(fit: Fit) -> str:
    if fit.cause == "clock_off":
        return f"telemetry.time_offset: {fit.value:+.2f} s less than now ({{seconds: {-fit.value:.2f}}} if it is 0)"
    if fit.cause == "heading_off":
        return f"telemetry.yaw_offset: {{degrees: {math.degrees(fit.value):.0f}}}"
    if fit.cause == "height_off":
        return f"telemetry.takeoff_height or height_datum: heights {fit.value:+.1f} m"
    if fit.cause == "focal_length":
        return f"camera: a focal length {fit.value:.2f} times as long"
    if fit.cause == "pitch_sign":
        return "a telemetry whose pitch is negative downward"
    return "exchange the streams' telemetry.file"
