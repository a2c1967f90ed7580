"""Checks of a log against its satellite; where they contradict each other, the slip that explains it is named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from satid_gym.estimators.batch.fit import NotIdentifiedError
from satid_gym.estimators.inertia import inertia_tensors
from satid_gym.identification.bad_readings.notes import with_notes
from satid_gym.identification.estimate import Estimated, estimate
from satid_gym.identification.judgement import determined
from satid_gym.identification.slips.candidates import Slip, attitude_slips, rate_slips, slips_of
from satid_gym.rigid_body import least_second_moment
from satid_gym.satellite import Satellite
from satid_gym.telemetry.log import GAP, Log

RATIO_MAX = 3.0  # of moments to nominal, either way, that is believed
_UNEXPLAINED_MAX = 0.35  # of what theta has to explain; more is no balance of momentum
_AGREEMENT_MAX = 0.5  # relative difference of attitude's and gyro's rates
_BETTER = 4.0  # times less of it with a slip undone is no chance
_LEVEL = 1.2  # times the score of the likeliest slip, up to which another explains as much
_THERE_MIN = 0.5  # of the rows that have an attitude, below which the gyro is integrated instead
_TRIED = 2  # flights that slips are tried on
_NOTHING = "the logs identify none of the moments of inertia"


class SlipError(ValueError):
    """The log contradicts the satellite; the message says what was found, what was expected, and the likely slip."""


def contradiction(found: Estimated, satellite: Satellite, sizes: np.ndarray) -> str:
    """Description of what is wrong with a fit; "" if nothing is."""
    fit, moments = found.fit, found.fit.theta[:3]
    larger = np.concatenate([np.maximum(sizes[:3], moments), sizes[3:]])  # where units are wrong, nominal says little
    known = determined(fit, fit.covariance, larger, satellite.gyro_noise_std)[:3]
    if fit.unexplained > _UNEXPLAINED_MAX and known.any():
        return f"{fit.unexplained:.0%} of the wheels' momentum changes stay unexplained, expected well below 35 %"
    if not known.any():
        return _NOTHING
    bodiless = known.all() and least_second_moment(inertia_tensors(fit.theta)) < -0.1 * np.abs(moments).max()
    if (moments[known] <= 0.0).any() or bodiless:
        return f"the moments of inertia come out as {_text(moments)} kg m^2, which no rigid body can have"
    moments, nominal = moments[known], np.diag(satellite.inertia)[known]
    ratio = float(np.exp(np.log(moments / nominal).mean()))
    if not 1.0 / RATIO_MAX < ratio < RATIO_MAX:
        return f"the moments of inertia come out as {_text(moments)} kg m^2, {ratio:.3g} times nominal {_text(nominal)}"
    return ""


def _text(values: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.3g}" for value in values) + ")"


def check_motion(logs: Sequence[Log], satellite: Satellite) -> None:
    """Refuse logs without motion.

    Raises:
        NotIdentifiedError: no rate or no wheel speed changes by more than the sensors' noise.
    """
    for name, noise in (("rate", satellite.gyro_noise_std), ("wheel_speed", satellite.tachometer_noise_std)):
        values = [getattr(log, name) for log in logs]
        there = [value[np.isfinite(value).all(axis=1)] for value in values]
        spread = max(float(value.std(axis=0).max()) if len(value) else 0.0 for value in there)
        if not spread > 3.0 * noise:
            still = (
                f"the logs do not identify the inertia: {name} changes by {spread:.2g} rad/s, expected more than three "
                f"times the sensor's noise of {noise:.2g}; nothing moves, or readings are missing"
            )
            raise NotIdentifiedError(with_notes(still, logs))


def check_attitude(logs: Sequence[Log]) -> list[Log]:
    """Logs whose attitude agrees with their gyro; an attitude that disagrees is left out, with a note.

    Raises:
        SlipError: it would, in another order, in the other direction, or with the gyro in other units or axes.
    """
    found = []
    for log in logs:
        if log.attitude is None:
            found.append(log)
            continue
        there = float(np.isfinite(log.attitude).all(axis=1).mean())
        if there < _THERE_MIN:
            note = f"attitude is there in {there:.0%} of the rows and is left out"
            found.append(replace(log, attitude=None, notes=(*log.notes, note)))
            continue
        apart = _disagreement(log)
        tried = [(s, _disagreement(s.undo(log))) for s in (*attitude_slips(), *rate_slips(log, proven=True))]
        slip, left = min(tried, key=lambda pair: pair[1])
        if left < min(0.5 * _AGREEMENT_MAX, apart / _BETTER):
            raise SlipError(
                f"{log.name}: attitude and gyro differ by {apart:.0%} of the rate; {slip.name} explains it "
                f"({left:.0%}): {slip.remedy}"
            )
        if apart < _AGREEMENT_MAX:
            found.append(log)
            continue
        note = f"attitude differs from the gyro by {apart:.0%} of the rate and is left out"
        found.append(replace(log, attitude=None, notes=(*log.notes, note)))
    return found


def check_fit(
    logs: Sequence[Log], satellite: Satellite, window: float, sizes: np.ndarray, found: Estimated | None
) -> str:
    """A note on doubts about a fit; None stands for logs without any window.

    Raises:
        SlipError: the logs contradict the satellite, and for all that is known only a slip, or none, explains it.
    """
    wrong = "no stretch is fit to identify from" if found is None else contradiction(found, satellite, sizes)
    if not wrong:
        return ""
    few = sorted(logs, key=len)[-_TRIED:]
    explain: list[tuple[float, Slip]] = []
    for slip in slips_of(few, satellite):
        try:
            tried = estimate([slip.undo(log) for log in few], satellite, window, turns=2)
        except (NotIdentifiedError, np.linalg.LinAlgError):
            continue
        known = determined(tried.fit, tried.fit.covariance, sizes, satellite.gyro_noise_std)
        if known[:3].all() and not contradiction(tried, satellite, sizes):
            far = np.abs(np.log(tried.fit.theta[:3] / np.diag(satellite.inertia))).max()
            explain.append((tried.fit.unexplained * (1.0 + far), slip))
    if explain:
        best = min(explain, key=lambda pair: pair[0])
        others = [slip for score, slip in explain if score < _LEVEL * best[0] and slip is not best[1]]
        also = "".join(f"; {slip.name} explains it as well: {slip.remedy}" for slip in others)
        also += "; or is nominal so far off?" if "times nominal" in wrong else ""
        raise SlipError(f"{wrong}; {best[1].name} explains it: {best[1].remedy}{also}")
    if found is None:
        raise NotIdentifiedError(
            with_notes("no stretch of the logs is fit to identify from: only gaps, or turns too fast to follow", logs)
        )
    if wrong == _NOTHING:
        return ""  # what is told of each is said where the estimate is judged
    if "times nominal" in wrong:
        return f"{wrong}: is its nominal inertia right, and its rotors' inertia, with which the result scales?"
    wrong += "; no single slip of units, signs or axes explains it: check columns, wheels and axes"
    raise SlipError(with_notes(wrong, logs))


def _disagreement(log: Log) -> float:
    """Median difference of attitude's and gyro's rates over the median rate; 0 where nothing turns."""
    assert log.attitude is not None
    good = np.flatnonzero(np.isfinite(np.hstack([log.rate, log.attitude])).all(axis=1))
    time, rate = log.time[good], log.rate[good]
    step = np.diff(time)
    if len(step) == 0:
        return 0.0
    turn = Rotation.from_quat(log.attitude[good])
    seen = (turn[:-1].inv() * turn[1:]).as_rotvec() / step[:, None]
    mean = 0.5 * (rate[1:] + rate[:-1])
    near = step <= GAP * np.median(step)
    size = np.median(np.linalg.norm(mean[near], axis=1))
    noise = 0.01 / np.median(step)  # rad/s: attitudes are hardly given to better than 0.01 rad in telemetry
    return float(np.median(np.linalg.norm(seen[near] - mean[near], axis=1)) / max(size, noise))
