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
    """noise_px, noise_share: of a displacement: what terrain, compression and matching add (one deviation).

    most_misfit: of telemetry that is right, see ``misfit``; a judgement, its grounds are in docs/checks.md. alike:
    kinds whose misfits differ by no more than this factor cannot be told apart. least_motion_px: of the median patch;
    with less there is nothing to compare. least_patches: that must be found again.
    """

    noise_px: float = 0.3
    noise_share: float = 0.06
    most_misfit: float = 1.0
    alike: float = 1.5
    least_motion_px: float = 1.0
    least_patches: int = 24


@dataclass(frozen=True, slots=True)
class Fit:
    """The best value of one kind of fault. misfit: with it."""

    cause: str
    value: float
    misfit: float


def misfit(
    measured_px: FloatArray, predicted_px: FloatArray, burst: NDArray[np.int64], params: MotionCheckParams
) -> float:
    """Mean squared residual (M, 2) in deviations, each at most 16; a burst counts once, however many patches it has.

    About 0.1 to 0.5 for telemetry that is right. A patch that should not be in sight counts 16.
    """
    sd = params.noise_px + params.noise_share * np.hypot(*measured_px.T)
    squared = ((measured_px - predicted_px) ** 2).sum(axis=1) / sd**2
    squared = np.minimum(np.where(np.isfinite(squared), squared, 16.0), 16.0)
    sums = np.bincount(burst, squared)
    counts = np.bincount(burst)
    return float(np.mean(sums[counts > 0] / counts[counts > 0]))


#: kind -> the values that are tried first, and what they mean
_GRIDS: Mapping[str, tuple[Sequence[float], Callable[[float], Assumption]]] = {
    "clock_off": (np.arange(-6.0, 6.01, 0.15).tolist(), lambda v: Assumption(clock_s=v)),
    "heading_off": (np.radians(np.arange(-180.0, 180.0, 6.0)).tolist(), lambda v: Assumption(yaw_rad=v)),
    "height_off": (np.arange(-60.0, 60.1, 1.5).tolist(), lambda v: Assumption(height_m=v)),
    "focal_length": (np.geomspace(0.5, 2.0, 41).tolist(), lambda v: Assumption(focal_scale=v)),
    "pitch_sign": ([-1.0], lambda v: Assumption(pitch_sign=v)),
}
#: steps in which a value is refined, as shares of the grid's step
_REFINED = (0.5, 0.25, 0.125, 0.0625)


def check_motion(
    where: str,
    motion: Motion,
    own: Predictor,
    others: Mapping[str, Predictor],
    params: MotionCheckParams | None = None,
) -> list[Finding]:
    """At most one finding. others: predictors of this video's motion from the other streams' telemetry, by name."""
    params = params or MotionCheckParams()
    measured = motion.displacement_px
    speed_px = float(np.median(np.hypot(*measured.T))) if len(measured) else 0.0
    if len(measured) < params.least_patches or speed_px < params.least_motion_px:
        text = f"its motion was not compared with the telemetry: {len(measured)} patches, moving {speed_px:.1f} pixels"
        return [
            Finding("assumed", "motion_unseen", where, text, "a hovering drone, or pictures without texture")
        ]

    def fits(predictor: Predictor, assumed: Assumption) -> float:
        return misfit(measured, predictor.displacement_px(assumed), motion.burst, params)

    as_it_is = fits(own, Assumption())
    if as_it_is <= params.most_misfit:
        return []
    found = [_best(cause, lambda a: fits(own, a)) for cause in _GRIDS]
    exchanged = [Fit(f"exchanged with {name}", 0.0, fits(p, Assumption())) for name, p in others.items()]
    found += [fit for fit in exchanged if fit.misfit <= params.most_misfit]
    found.sort(key=lambda fit: fit.misfit)
    evidence = (
        f"{len(measured)} patches in {motion.bursts} moments move {speed_px:.1f} pixels; their misfit to the "
        f"telemetry is {as_it_is:.2f}, at most {params.most_misfit:g} where it is right"
    )
    if own.is_still:
        text = "the drone does not move by its telemetry, and the pictures do"
        return [Finding("warning", "frozen", where, text, evidence, "telemetry.file: a recording with a fix")]
    best = found[0]
    if best.misfit > params.most_misfit:
        text = "the pictures do not move as the telemetry says, and no single fault explains it: another flight's?"
        mend = "telemetry.file: the one of this video"
        return [
            Finding(
                "warning",
                "other_flight",
                where,
                text,
                f"{evidence}; {_words(best)} leaves {best.misfit:.2f}",
                mend,
            )
        ]
    alike = [fit for fit in found if fit.misfit <= max(params.alike * best.misfit, 0.5 * params.most_misfit)]
    alike = _told_apart(alike, best)
    causes = "/".join(fit.cause.split(" ")[0] for fit in alike)
    text = "the pictures do not move as the telemetry says; they would with " + ", or with ".join(
        map(_words, alike)
    )
    proof = evidence + "; with it " + ", ".join(f"{fit.misfit:.2f}" for fit in alike)
    return [Finding("warning", causes, where, text, proof, " or ".join(_mend(fit) for fit in alike))]


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
