"""Slips that make a log contradict its satellite: units, signs, axes and quaternions, found by trying each."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from satid_gym.estimators.batch.fit import NotIdentifiedError
from satid_gym.estimators.inertia import inertia_tensors
from satid_gym.identification.estimate import Estimated, estimate
from satid_gym.identification.judgement import determined
from satid_gym.rigid_body import least_second_moment
from satid_gym.satellite import Satellite
from satid_gym.telemetry.columns import HOW
from satid_gym.telemetry.log import GAP, Log
from satid_gym.telemetry.units import DEGREE, RPM, option_of

RATIO_MAX = 3.0  # of moments to nominal, either way, that is believed
_UNEXPLAINED_MAX = 0.35  # of what theta has to explain; more is no balance of momentum
_AGREEMENT_MAX = 0.5  # relative difference of attitude's and gyro's rates
_THERE_MIN = 0.5  # of the rows that have an attitude, below which the gyro is integrated instead
_TRIED = 2  # flights that slips are tried on
_MINUS = "a minus sign before the unit that the log is in"
_REORDER = f"name the columns in this order, as in {HOW}"
_NOTHING = "the logs identify none of the moments of inertia"


class SlipError(ValueError):
    """The log contradicts the satellite; the message says what was found, what was expected, and the likely slip."""


@dataclass(frozen=True, eq=False)
class _Slip:
    name: str
    remedy: str
    undo: Callable[[Log], Log]


def contradiction(found: Estimated, satellite: Satellite, sizes: np.ndarray) -> str:
    """Description of what is wrong with a fit; "" if nothing is."""
    fit = found.fit
    known = determined(fit, fit.covariance, sizes, satellite.gyro_noise_std)
    if fit.unexplained > _UNEXPLAINED_MAX and known[:3].any():
        return f"{fit.unexplained:.0%} of the wheels' momentum changes stay unexplained, expected well below 35 %"
    if not known[:3].any():
        return _NOTHING
    if not known[:3].all():
        return ""
    moments, nominal = fit.theta[:3], np.diag(satellite.inertia)
    if (moments <= 0.0).any() or least_second_moment(inertia_tensors(fit.theta)) < -0.1 * np.abs(moments).max():
        return f"the moments of inertia come out as {_text(moments)} kg m^2, which no rigid body can have"
    ratio = float(np.exp(np.log(moments / nominal).mean()))
    if not 1.0 / RATIO_MAX < ratio < RATIO_MAX:
        return f"the moments of inertia come out as {_text(moments)} kg m^2, {ratio:.3g} times nominal {_text(nominal)}"
    return ""


def _text(values: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.3g}" for value in values) + ")"


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
        if _disagreement(log) < _AGREEMENT_MAX:
            found.append(log)
            continue
        tried = [(slip, _disagreement(slip.undo(log))) for slip in [*_attitude_slips(), *_rate_slips()]]
        slip, left = min(tried, key=lambda pair: pair[1])
        if left < 0.5 * _AGREEMENT_MAX:
            raise SlipError(
                f"{log.name}: attitude and gyro differ by {_disagreement(log):.0%} of the rate, expected less than "
                f"{_AGREEMENT_MAX:.0%}; {slip.name} explains it ({left:.0%}): {slip.remedy}"
            )
        note = f"attitude differs from the gyro by {_disagreement(log):.0%} of the rate and is left out"
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
    best: tuple[float, _Slip] | None = None
    for slip in _slips(satellite.wheels.count):
        try:
            tried = estimate([slip.undo(log) for log in few], satellite, window, turns=2)
        except (NotIdentifiedError, np.linalg.LinAlgError):
            continue
        known = determined(tried.fit, tried.fit.covariance, sizes, satellite.gyro_noise_std)
        if known[:3].all() and not contradiction(tried, satellite, sizes):
            far = np.abs(np.log(tried.fit.theta[:3] / np.diag(satellite.inertia))).max()
            score = tried.fit.unexplained * (1.0 + far)
            if best is None or score < best[0]:
                best = score, slip
    if best is not None:
        also = "; or is nominal so far off?" if "times nominal" in wrong else ""
        raise SlipError(f"{wrong}; {best[1].name} explains it: {best[1].remedy}{also}")
    if found is None:
        raise NotIdentifiedError(
            "no stretch of the logs is fit to identify from: only gaps, or turns too fast to follow"
        )
    if wrong == _NOTHING:
        return ""  # what is told of each is said where the estimate is judged
    if "times nominal" in wrong:
        return f"{wrong}: is the satellite's nominal inertia right?"
    raise SlipError(f"{wrong}; no single slip of units, signs or axes explains it: check columns, wheels and axes")


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


def _slips(wheels: int) -> Iterator[_Slip]:
    yield from _rate_slips()
    for name, factor, unit in (
        ("wheel speeds in rpm that were read as rad/s", RPM, "rpm"),
        ("wheel speeds in rad/s that were read as rpm", 1.0 / RPM, "rad/s"),
        ("all wheel speeds with the opposite sign", -1.0, "-rad/s"),
        ("wheel speeds in rpm with the opposite sign", -RPM, "-rpm"),
    ):
        minus = f"{_MINUS}, " if factor == -1.0 else ""
        remedy = f"give {minus}{option_of({'wheel_speed': unit})}"
        yield _Slip(name, remedy, _scaled("wheel_speed", np.full(wheels, factor)))
    both = _scaled("rate", np.full(3, DEGREE)), _scaled("wheel_speed", np.full(wheels, RPM))
    yield _Slip(
        "gyro rates in deg/s and wheel speeds in rpm, both read as rad/s",
        f"give {option_of({'rate': 'deg/s', 'wheel_speed': 'rpm'})}",
        lambda log: both[0](both[1](log)),
    )
    for k in range(wheels):
        signs = np.where(np.arange(wheels) == k, -1.0, 1.0)
        yield _Slip(
            f"wheel {k + 1} with the opposite sign",
            f"negate column {k + 1} of wheel_speed in the file, or its axis in the satellite's",
            _scaled("wheel_speed", signs),
        )
    orders = list(itertools.permutations(range(wheels))) if wheels == 3 else list(_exchanges(wheels))
    for order in orders[1:] if wheels == 3 else orders:
        names = ", ".join(str(k + 1) for k in order)
        yield _Slip(f"wheels in the order {names}", _REORDER, _ordered("wheel_speed", order))


def _exchanges(count: int) -> Iterator[tuple[int, ...]]:
    for i, j in itertools.combinations(range(count), 2):
        order = list(range(count))
        order[i], order[j] = j, i
        yield tuple(order)


def _rate_slips() -> Iterator[_Slip]:
    yield _Slip(
        "gyro rates in deg/s that were read as rad/s",
        f"give {option_of({'rate': 'deg/s'})}",
        _scaled("rate", np.full(3, DEGREE)),
    )
    yield _Slip(
        "gyro rates in rad/s that were read as deg/s",
        f"give {option_of({'rate': 'rad/s'})}",
        _scaled("rate", np.full(3, 1.0 / DEGREE)),
    )
    remedy = f"give {_MINUS}, {option_of({'rate': '-rad/s'})}"
    yield _Slip("gyro rates with the opposite sign", remedy, _scaled("rate", -np.ones(3)))
    for order in list(itertools.permutations(range(3)))[1:]:
        names = ", ".join("xyz"[k] for k in order)
        yield _Slip(f"gyro axes in the order {names}", _REORDER, _ordered("rate", order))
    for k in range(3):
        signs = np.where(np.arange(3) == k, -1.0, 1.0)
        remedy = f"negate column {k + 1} of rate in the file"
        yield _Slip(f"gyro axis {'xyz'[k]} with the opposite sign", remedy, _scaled("rate", signs))


def _attitude_slips() -> Iterator[_Slip]:
    first = "a quaternion that is scalar first and was read as scalar last"
    last = "a quaternion that is scalar last and was read as scalar first"
    inverse = "a quaternion from inertial to body that was read as body to inertial"
    conjugate = np.array([-1.0, -1.0, -1.0, 1.0])
    negate = "negate these columns in the file: those of its vector part"
    yield _Slip(first, f"give {option_of({'attitude': 'scalar first'})}", _rolled(-1, np.ones(4)))
    yield _Slip(last, f"give {option_of({'attitude': 'scalar last'})}", _rolled(1, np.ones(4)))
    yield _Slip(inverse, negate, _rolled(0, conjugate))
    both = f"give {option_of({'attitude': 'scalar first'})}, and {negate}"
    yield _Slip(f"{first}, and {inverse[2:]}", both, _rolled(-1, conjugate))


def _scaled(role: str, factors: np.ndarray) -> Callable[[Log], Log]:
    return lambda log: replace(log, **{role: getattr(log, role) * factors})


def _ordered(role: str, order: Sequence[int]) -> Callable[[Log], Log]:
    return lambda log: replace(log, **{role: getattr(log, role)[:, list(order)]})


def _rolled(places: int, signs: np.ndarray) -> Callable[[Log], Log]:
    return lambda log: replace(log, attitude=np.roll(np.asarray(log.attitude), places, axis=1) * signs)
