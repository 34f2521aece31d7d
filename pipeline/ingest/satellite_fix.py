"""How good a position is, from what a receiver says of its fix."""

from __future__ import annotations

import math

import numpy as np

from pipeline.messages import FloatArray

#: kinds of fix, as MAVLink, ArduPilot and PX4 count them; below 3 there is no position in three dimensions
FIX_3D = 3.0
#: standard deviation of a range to a satellite, metres, by the kind of fix: 3-D, differential, RTK float, RTK fixed.
#: Those of u-blox' data sheets (2.5, 1, 0.2, 0.01 m within which half of the positions lie), rounded up.
_RANGE_ERROR_M = {3.0: 3.0, 4.0: 1.5, 5.0: 0.4, 6.0: 0.03}
#: of a receiver that states no dilution
_USUAL_HDOP, _VDOP_OVER_HDOP = 1.0, 1.5


def horizontal_sd_m(fix: FloatArray, accuracy_m: FloatArray, hdop: FloatArray) -> FloatArray:
    """Standard deviation of each horizontal axis (N,), metres.

    accuracy_m: the receiver's estimate of its horizontal error, a distance, so each axis has 1 / sqrt(2) of it;
    where it states none (NaN or 0), the dilution times the error of a range: HDOP^2 = (sE^2 + sN^2) / s^2.
    """
    dilution = np.where(np.isfinite(hdop) & (hdop > 0.0), hdop, _USUAL_HDOP)
    stated = np.isfinite(accuracy_m) & (accuracy_m > 0.0)
    return np.where(stated, accuracy_m, dilution * _range_error_m(fix)) / math.sqrt(2.0)


def height_sd_m(fix: FloatArray, accuracy_m: FloatArray, vdop: FloatArray, hdop: FloatArray) -> FloatArray:
    """Standard deviation of the height (N,), metres, by the same rule; without a VDOP, 1.5 times the HDOP."""
    usual = np.where(np.isfinite(hdop) & (hdop > 0.0), hdop, _USUAL_HDOP) * _VDOP_OVER_HDOP
    dilution = np.where(np.isfinite(vdop) & (vdop > 0.0), vdop, usual)
    stated = np.isfinite(accuracy_m) & (accuracy_m > 0.0)
    return np.where(stated, accuracy_m, dilution * _range_error_m(fix))


def _range_error_m(fix: FloatArray) -> FloatArray:
    error_m = np.full(len(fix), _RANGE_ERROR_M[FIX_3D])
    for kind, value_m in _RANGE_ERROR_M.items():
        error_m[fix == kind] = value_m
    return error_m
