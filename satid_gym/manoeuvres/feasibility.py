"""Feasibility: the accuracy that no manoeuvre within the limits can reach, and the changes that would allow it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from satid_gym.bounds import TrueMotion, envelope_bound
from satid_gym.estimators.momentum import MomentumEKFSettings
from satid_gym.policy import Mission
from satid_gym.satellite import Satellite
from satid_gym.scenario import Scenario, prior_of

_FARTHEST = 16.0  # factor on a limit or on the duration beyond which it is no remedy
_HALVINGS = 12
_DISTURBANCE = 3.0  # standard deviations of the disturbance torque that may help
_CLOSE = 1.005  # of a limit that is given, so that its rounded figure is enough


class NotPossibleError(ValueError):
    """The request is infeasible; the message says what would make it feasible."""


def least_std(mission: Mission, duration: float) -> np.ndarray:
    """Least standard deviation (T,) of the worst moment over its prior, sample by sample, that any motion can reach.

    The envelope bound of a nominal, rigid satellite whose wheels store at first as much as the scenario draws, its
    sensors without errors but noise. Of the same satellite with other errors it is a bound too; one that turns out
    lighter may be told a little better.
    """
    sheet, period = mission.satellite, mission.scenario.sample_period
    samples = round(duration / period) + 1
    still, wheels = np.zeros((1, samples, 3)), sheet.wheels
    stored = wheels.momentum_reach * mission.scenario.wheel_speed_range
    motion = TrueMotion(
        momentum=np.broadcast_to(stored, still.shape),
        rate=still,
        wheel_speed=np.zeros((1, samples, wheels.count)),
        inertia=np.broadcast_to(sheet.inertia, (1, samples, 3, 3)),
        torque=np.full_like(still, _DISTURBANCE * sheet.disturbance_std),
    )
    settings = MomentumEKFSettings(inertia_walk=0.0)
    variance = envelope_bound(motion, sheet, mission.prior, settings, period)[0, :, :3]
    return np.sqrt(variance / mission.prior.theta_scale(mission.prior.needed_parameters)[:3] ** 2).max(axis=1)


def check_accuracy(mission: Mission, duration: float, accuracy: float) -> None:
    """Refuse an accuracy that no manoeuvre of this duration can reach.

    Raises:
        NotPossibleError: no manoeuvre reaches it; the message has the longer duration, the higher rate limit or
            the better gyro that the bound allows it with, if any.
    """
    least = least_std(mission, duration)[-1]
    if least <= accuracy:
        return
    sheet, world = mission.satellite, mission.scenario
    longer = least_std(mission, _FARTHEST * duration) <= accuracy
    needed_time = world.decision_period * np.ceil(world.sample_period * np.argmax(longer) / world.decision_period)
    remedies = [f"{needed_time:g} s"] if longer.any() else []
    free = sheet.replace(sensors=sheet.sensors.replace(gyro_range=None))  # a faster gyro comes with a higher limit
    faster = _least_factor(
        lambda factor: _bound(free.replace(rate_limit=factor * sheet.rate_limit), world, duration) <= accuracy
    )
    if faster is not None:
        remedies.append(f"a rate limit of {faster * sheet.rate_limit:.3g} rad/s")
    quieter = _least_factor(
        lambda factor: _bound(sheet.replace(gyro_noise_std=sheet.gyro_noise_std / factor), world, duration) <= accuracy
    )
    if quieter is not None:
        remedies.append(f"gyro noise of {sheet.gyro_noise_std / quieter:.2g} rad/s")
    needed = (
        f"it takes at least {', or '.join(remedies)}"
        if remedies
        else (f"no duration, rate limit or gyro {_FARTHEST:g} times as good is enough by itself")
    )
    raise NotPossibleError(
        f"no manoeuvre of {duration:g} s determines every moment of inertia to {accuracy:.2g}: whatever the satellite "
        f"does within its limits, noise leaves {least:.2g}; {needed}"
    )


def _bound(satellite: Satellite, world: Scenario, duration: float) -> float:
    """Least standard deviation at the end, for a data sheet with its own limits."""
    own = world.replace(rate_limit=None, gyro_noise_std=None, wheel_speed_scale=1.0)
    mission = Mission(
        satellite=satellite,
        prior=prior_of(satellite, own),
        estimator=world.estimator,
        scenario=own,
        layout={},
    )
    return float(least_std(mission, duration)[-1])


def _least_factor(enough: Callable[[float], bool]) -> float | None:
    """Least sufficient factor from 1 on, to about a thousandth, rounded up; None if none is enough."""
    low, high = 1.0, _FARTHEST
    if not enough(high):
        return None
    for _ in range(_HALVINGS):
        middle = np.sqrt(low * high)
        low, high = (low, middle) if enough(middle) else (middle, high)
    return _CLOSE * float(high)
