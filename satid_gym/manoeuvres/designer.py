"""Design of a manoeuvre: from a data sheet to rates and torques, with the predicted accuracy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from satid_gym.estimators.settings import EstimatorSettings
from satid_gym.evaluation import Split, seeds
from satid_gym.gym_api import COSTS
from satid_gym.manoeuvres.feasibility import NotPossibleError, check_accuracy, least_std
from satid_gym.manoeuvres.notes import remarks
from satid_gym.manoeuvres.policy import ManoeuvrePolicy
from satid_gym.manoeuvres.request import KeepOut, Request
from satid_gym.manoeuvres.rivals import rivals
from satid_gym.manoeuvres.search import Effort, Progress, manoeuvres, pointing_excess, search, settling
from satid_gym.manoeuvres.trial import Trial, fly_side_by_side
from satid_gym.manoeuvres.waves import Manoeuvre, Waves
from satid_gym.policy import Mission, only_mission
from satid_gym.problem import Problem, problem
from satid_gym.resolution import SatelliteLike, ScenarioLike, resolve_scenario
from satid_gym.scenario import Scenario

CONSTANT = {"name": "momentum", "inertia_walk": 0.0}
"""Filter for a manoeuvre in which the inertia does not change."""
_DECISIONS_MIN, _DECISIONS_MAX = 8, 20_000
_FAST_WHEELS = 0.5  # of the speed limit
_UNSURE = ("gyro_scale", "gyro_alignment", "wheel_inertia", "wheel_alignment")  # tolerances that no time averages out
_HINDERS = 0.1  # share of the accuracy that is asked for, up to which such a tolerance does not matter
_LONGER = (2.0, 4.0, 8.0)  # durations that are tried where accuracy falls short


@dataclass(frozen=True, eq=False, kw_only=True)
class Design:
    """A manoeuvre and its results; all flights are of random satellites around the data sheet, on test seeds.

    Attributes:
        mission: satellite, prior and world that it was designed for, and the control that it is flown by.
        request: the request.
        manoeuvre: the best manoeuvre found.
        trial: its flights.
        open_loop: flights of its torque in open loop, if it was designed for a rate loop.
        rivals: flights of other excitation, each with its best settings.
        stressed: flights of the manoeuvre in harder worlds, by name; the filter knows of the changes except of the
            inertia.
        least: (T,) standard deviation of the nominal satellite's worst moment over its prior that no motion within the
            limits can beat, at each sample from 0 on.
        notes: notes for the reader.
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

    @property
    def scale(self) -> np.ndarray:
        """(p,) kg m^2 that `trial.std` is relative to: prior moments, for products their geometric means."""
        return self.mission.prior.theta_scale(self.trial.parameters)


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
    """Manoeuvre that identifies a satellite's inertia best, from rest to rest, within all limits of its data sheet.

    Args:
        satellite: one data sheet: name, file, mapping or `Satellite`.
        duration, accuracy, returns, turn_limit, keep_outs: see `Request`.
        scenario: noise, prior and periods, as for the environment; its horizon is replaced by the duration.
        estimator: a compiled filter, by name or settings; None: "momentum" for a constant inertia.
        control: "rate": a rate loop tracks it; "torque": torque in open loop.
        effort: how long to search.
        progress: called with lines of progress.

    Raises:
        NotPossibleError: no manoeuvre keeps the limits, or reaches the accuracy; the message says what would help.
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
    posed = problem(satellite, "static", _world(scenario, request), estimator or CONSTANT, control=control)
    if len(posed.satellites) != 1:
        raise ValueError(f"a manoeuvre is designed for one data sheet, and {satellite!r} stands for several: give one")
    mission, effort = only_mission(posed), effort or Effort()
    if request.accuracy is not None:
        check_accuracy(mission, request.duration, request.accuracy)
    progress(f"searching for {mission.satellite.name}; the first flights of a new kind of satellite compile the filter")
    waves = search(posed, request, effort, progress)
    (manoeuvre,) = manoeuvres(waves, request, posed, mission.satellite)
    trial = _flown(manoeuvre, posed, request, effort)
    if beyond := _beyond(trial, request, control):
        raise NotPossibleError(f"no manoeuvre was found that keeps the limits: with the best, {beyond}")
    if request.accuracy is not None and trial.accuracy > request.accuracy:
        raise NotPossibleError(_falls_short(waves, posed, request, effort, trial))
    progress("flying it in harder worlds")
    by_torque = posed.replace(control="torque")
    others = rivals(posed, request, effort, progress)
    return Design(
        mission=mission,
        request=request,
        manoeuvre=manoeuvre,
        trial=trial,
        open_loop=_flown(manoeuvre, by_torque, request, effort) if control == "rate" else None,
        rivals=tuple(others),
        stressed={
            name: _flown(manoeuvre, posed.replace(scenario=harder), request, effort)
            for name, harder in _harder(posed.scenario).items()
        },
        least=least_std(mission, request.duration),
        notes=tuple(remarks(mission, request, trial, others)),
    )


def _world(scenario: ScenarioLike, request: Request) -> Scenario:
    """The scenario with the manoeuvre's duration as its horizon.

    Raises:
        ValueError: it draws data sheets of its own, or the duration is no multiple of its decisions or too short.
    """
    world = resolve_scenario(scenario)
    if world.appendages is not None:
        raise ValueError(
            f"scenario {world.name!r} draws panels or a tank for the satellite: design for a data sheet that has them"
        )
    period, rest = world.decision_period, settling(world)
    shortest = rest + _DECISIONS_MIN * period
    if request.duration < shortest:
        raise ValueError(
            f"duration must be at least {shortest:g} s, got {request.duration:g}: {_DECISIONS_MIN} decisions of "
            f"{period:g} s, and {rest:g} s to come to rest"
        )
    whole = period * round(request.duration / period)
    if abs(whole - request.duration) > 1e-9 * request.duration or request.duration > _DECISIONS_MAX * period:
        raise ValueError(
            f"duration must be a multiple of the scenario's decisions of {period:g} s and at most "
            f"{_DECISIONS_MAX * period:g} s, got {request.duration:g}"
        )
    return world.replace(horizon=request.duration)


def _flown(manoeuvre: Manoeuvre, world: Problem, request: Request, effort: Effort, split: Split = "test") -> Trial:
    """Flights of a manoeuvre by the control of a world."""
    policies = [ManoeuvrePolicy(manoeuvre)]
    (trial,) = fly_side_by_side(world, policies, seeds(split, effort.flights), request.keep_outs)
    return trial


def _harder(world: Scenario) -> dict[str, Scenario]:
    """Worlds that are harder than the scenario, by name; the filter knows of the changes except of the inertia."""
    faster = {"wheels faster at the start": world.replace(wheel_speed_range=_FAST_WHEELS)}
    return {
        "inertia twice as far off": world.replace(inertia_std=2.0 * world.inertia_std),
        "motor noise doubled": world.replace(torque_noise=2.0 * world.torque_noise),
        **(faster if world.wheel_speed_range < _FAST_WHEELS else {}),
        "disturbance five times": world.replace(disturbance_scale=5.0 * world.disturbance_scale),
    }


def _beyond(trial: Trial, request: Request, control: str) -> str:
    """Description of the limit that flights exceed, and what would help; "" if none."""
    if trial.terminated.any():
        return (
            f"{trial.terminated.mean():.0%} of the flights ended early, far beyond a limit: give higher limits, a "
            "quieter gyro, or another control"
        )
    if trial.beyond > request.cost_limit:
        name = COSTS[int(trial.costs.mean(axis=0).argmax())]
        return (
            f"the limit of {name.replace('_', ' ')} is exceeded for {trial.beyond:.1%} of the time, and "
            f"{request.cost_limit:.1%} is allowed: raise it, give the manoeuvre longer, or search for more rounds"
        )
    if (excess := pointing_excess(trial, request)) > 0.0:
        return (
            f"a flight points {np.degrees(excess):.2g} deg beyond its turn limit or into a keep-out: give it more room"
            + (
                " or search for more rounds"
                if control == "rate"
                else ', search for more rounds, or fly by control "rate"'
            )
        )
    return ""


def _falls_short(waves: Waves, posed: Problem, request: Request, effort: Effort, trial: Trial) -> str:
    """What is said where the best manoeuvre does not reach the accuracy, with the duration in which its waves would."""
    said = f"the best manoeuvre of {request.duration:g} s leaves {trial.accuracy:.2g} of a moment of inertia"
    for factor in _LONGER:
        longer = request.replace(duration=factor * request.duration)
        world = posed.replace(scenario=posed.scenario.replace(horizon=longer.duration))
        (manoeuvre,) = manoeuvres(waves, longer, world, only_mission(world).satellite)
        found = _flown(manoeuvre, world, longer, effort, "tuning")
        if (
            request.accuracy is not None
            and found.accuracy <= request.accuracy
            and not _beyond(found, longer, posed.control)
        ):
            return f"{said}; {longer.duration:g} s of the same waves leave {found.accuracy:.2g}"
    tolerances = only_mission(posed).satellite.tolerances
    least = _HINDERS * (request.accuracy or 0.0)
    unsure = [name for name in _UNSURE if getattr(tolerances, name) > least]
    better = f"smaller tolerances ({', '.join(unsure)}), wider limits" if unsure else "wider limits"
    return f"{said}, and up to {longer.duration:g} s of the same waves do not help: give {better} or a quieter gyro"
