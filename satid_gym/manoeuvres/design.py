"""Design of a manoeuvre: from a data sheet to rates and torques, with the accuracy that they will bring."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from satid_gym.estimators.settings import EstimatorSettings
from satid_gym.evaluation import seeds
from satid_gym.manoeuvres.feasibility import NotPossibleError, check_accuracy, least_std
from satid_gym.manoeuvres.policy import ManoeuvrePolicy
from satid_gym.manoeuvres.request import KeepOut, Request
from satid_gym.manoeuvres.rivals import rivals
from satid_gym.manoeuvres.search import Effort, Progress, manoeuvres, search
from satid_gym.manoeuvres.trial import Trial, fly_side_by_side
from satid_gym.manoeuvres.waves import Manoeuvre, Waves
from satid_gym.policy import Mission, only_mission
from satid_gym.problem import Problem, problem
from satid_gym.resolution import SatelliteLike, ScenarioLike, resolve_scenario
from satid_gym.scenario import Scenario

CONSTANT = {"name": "momentum", "inertia_walk": 0.0}
"""Filter for a manoeuvre in which the inertia does not change."""
_LONGER = (2.0, 4.0, 8.0)  # durations that are tried where accuracy falls short


@dataclass(frozen=True, eq=False, kw_only=True)
class Design:
    """A manoeuvre and what it does; all flights are of satellites drawn about the data sheet, on test seeds.

    Attributes:
        mission: satellite, prior and world that it was designed for, and the control that it is flown by.
        request: what was asked.
        manoeuvre: the answer.
        trial: its flights.
        open_loop: flights of its torque in open loop, where it was designed for a rate loop.
        rivals: flights of other excitation, each with its best settings.
        stressed: flights of the manoeuvre in harder worlds, by name.
        least: (T,) standard deviation of the worst moment over its prior that no motion within the limits can beat,
            at each sample from 0 on.
        notes: what the reader should know.
    """

    mission: Mission
    request: Request
    manoeuvre: Manoeuvre
    trial: Trial
    open_loop: Trial | None
    rivals: tuple[Trial, ...]
    stressed: Mapping[str, Trial]
    least: np.ndarray
    notes: tuple[str, ...]


def design(
    satellite: SatelliteLike,
    *,
    duration: float = 300.0,
    accuracy: float | None = None,
    returns: bool = False,
    turn_limit: float | None = None,
    keep_outs: Sequence[KeepOut | Mapping[str, Any]] = (),
    scenario: ScenarioLike = "default",
    estimator: str | Mapping[str, Any] | EstimatorSettings | None = None,
    control: str = "rate",
    effort: Effort | None = None,
    progress: Progress = lambda line: None,
) -> Design:
    """Manoeuvre that tells a satellite's inertia best, from rest to rest, within all limits of its data sheet.

    Args:
        satellite: one data sheet: name, file, mapping or `Satellite`.
        duration, accuracy, returns, turn_limit, keep_outs: see `Request`.
        scenario: noise, prior and periods, as for the environment; its horizon gives way to the duration.
        estimator: a compiled filter, by name or settings; None: "momentum" for an inertia that stays as it is.
        control: "rate" where a rate loop flies it, "torque" where torque is played in open loop.
        effort: how long to search.
        progress: is told, line by line, how far it is.

    Raises:
        NotPossibleError: no manoeuvre keeps the limits, or reaches the accuracy; the message says what would.
        ValueError: an argument is not valid.
    """
    request = Request.from_dict(
        {
            "duration": duration,
            "accuracy": accuracy,
            "returns": returns,
            "turn_limit": turn_limit,
            "keep_outs": tuple(keep_outs),
        }
    )
    world = resolve_scenario(scenario).replace(horizon=request.duration)
    posed = problem(satellite, "static", world, estimator or CONSTANT, control=control)
    if len(posed.satellites) != 1:
        raise ValueError(f"a manoeuvre is designed for one data sheet, and {satellite!r} stands for several: give one")
    mission, effort = only_mission(posed), effort or Effort()
    if request.accuracy is not None:
        check_accuracy(mission, request.duration, request.accuracy)
    progress(f"searching for {mission.satellite.name}; the first flights of a new kind of satellite compile the filter")
    waves = search(posed, request, effort, progress)
    (manoeuvre,) = manoeuvres(waves, request, posed, mission.satellite)
    trial = _flown(manoeuvre, posed, request, effort)
    _check_limits(trial, request)
    if request.accuracy is not None and trial.accuracy > request.accuracy:
        raise NotPossibleError(_falls_short(waves, posed, request, effort, trial))
    progress("flying it in harder worlds")
    by_torque = posed.replace(control="torque")
    return Design(
        mission=mission,
        request=request,
        manoeuvre=manoeuvre,
        trial=trial,
        open_loop=_flown(manoeuvre, by_torque, request, effort) if control == "rate" else None,
        rivals=tuple(rivals(posed, request, effort, progress)),
        stressed={
            name: _flown(manoeuvre, posed.replace(scenario=harder), request, effort)
            for name, harder in _harder(posed.scenario).items()
        },
        least=least_std(mission, request.duration),
        notes=tuple(_notes(mission, trial)),
    )


def _flown(manoeuvre: Manoeuvre, world: Problem, request: Request, effort: Effort) -> Trial:
    """Flights of a manoeuvre by the control of a world, on test seeds."""
    (trial,) = fly_side_by_side(world, [ManoeuvrePolicy(manoeuvre)], seeds("test", effort.flights), request.keep_outs)
    return trial


def _harder(world: Scenario) -> dict[str, Scenario]:
    """Worlds that are worse than the data sheet says, by name."""
    return {
        "inertia twice as far off": world.replace(inertia_std=2.0 * world.inertia_std),
        "motor noise doubled": world.replace(torque_noise=2.0 * world.torque_noise),
        "wheels faster at the start": world.replace(wheel_speed_range=max(0.5, world.wheel_speed_range)),
        "disturbance five times": world.replace(disturbance_scale=5.0 * world.disturbance_scale),
    }


def _check_limits(trial: Trial, request: Request) -> None:
    """Refuse a manoeuvre that leaves the limits, which the search could not avoid."""
    if trial.terminated.any():
        raise NotPossibleError(
            f"{trial.terminated.mean():.0%} of the flights ran away with the gentlest manoeuvre that was found: a rate "
            "or a deflection came to several times its limit. Allow more deflection or a higher rate, or fly it by a "
            'rate loop, control "rate"'
        )
    if trial.worst_cost > request.cost_limit:
        raise NotPossibleError(
            f"the best manoeuvre that was found has a limit exceeded for {trial.worst_cost:.1%} of the time, more than "
            f"{request.cost_limit:.1%}: raise the limit that it meets, give it longer, or fly it by a rate loop, "
            'control "rate"'
        )
    if trial.clearance.size and trial.clearance.min() < 0.0:
        raise NotPossibleError(
            f"a boresight came {np.degrees(-trial.clearance.min()):.1f} deg into its keep-out with the best manoeuvre "
            "that was found: begin farther from it, or give a turn limit"
        )


def _falls_short(waves: Waves, posed: Problem, request: Request, effort: Effort, trial: Trial) -> str:
    """What is said where the best manoeuvre does not reach the accuracy, with the duration in which its waves would."""
    said = f"the best manoeuvre of {request.duration:g} s leaves {trial.accuracy:.2g} of a moment of inertia"
    for factor in _LONGER:
        longer = request.replace(duration=factor * request.duration)
        world = posed.replace(scenario=posed.scenario.replace(horizon=longer.duration))
        (manoeuvre,) = manoeuvres(waves, longer, world, only_mission(world).satellite)
        accuracy = _flown(manoeuvre, world, longer, effort).accuracy
        if request.accuracy is not None and accuracy <= request.accuracy:
            return f"{said}; {longer.duration:g} s of the same waves leave {accuracy:.2g}"
    return (
        f"{said}, and {longer.duration:g} s of the same waves {accuracy:.2g}: a better gyro or wider limits are needed"
    )


def _notes(mission: Mission, trial: Trial) -> list[str]:
    notes = []
    sheet = mission.satellite
    if not sheet.tolerances.kinds[0]:
        notes.append(
            "the data sheet gives no gyro bias: the filter takes the gyro as without, and what it claims is as good"
        )
    if trial.rate.max() > 1.0:
        over = float((trial.rate > 1.0).mean())
        notes.append(f"in {over:.0%} of the flights a rate was beyond its limit at some time, by noise")
    return notes
