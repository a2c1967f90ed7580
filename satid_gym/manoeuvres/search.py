"""Search for the best manoeuvre, by the cross-entropy method over flights of random satellites.

Candidates are judged by what the filter knows at the end, so that all the data sheet says counts: noise, tolerances,
modes, late readings. What leaves the limits pays for it.

Source: Rubinstein and Kroese, The Cross-Entropy Method (2004).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from satid_gym.config import Config, check_integer
from satid_gym.evaluation import seeds
from satid_gym.manoeuvres.pointing import attitudes, separations, turned
from satid_gym.manoeuvres.policy import ManoeuvrePolicy
from satid_gym.manoeuvres.request import Request
from satid_gym.manoeuvres.trial import Trial, fly_side_by_side
from satid_gym.manoeuvres.waves import SIZE, Authority, Manoeuvre, Waves
from satid_gym.policy import only_mission
from satid_gym.problem import Problem
from satid_gym.profiles import wheel_torque
from satid_gym.satellite import Satellite
from satid_gym.scenario import Scenario

Progress = Callable[[str], None]

SLACK = 0.6  # of the limit on costs, for the few flights of the search tell them roughly
_COST, _EARLY, _POINTING = 100.0, 10.0, 30.0  # nats that a cost of 1, an early end, a radian beyond a limit pay
_TOUCH = 0.5  # nats that a limit pays which every flight exceeds at some time
_SPREAD = np.array([0.8, 0.8, *[0.25] * 3, *[0.25] * 3])  # of the first round's codes
_SPREAD_MIN = 0.02
_ELITE = 8
_ROUNDING = 1e-9  # of a count of decisions
_SETTLING = 4.0  # time constants of the rate loop that are left for coming to rest
_TURN_SLACK = np.radians(2.0)  # that is left for what noise turns the satellite


@dataclass(frozen=True, eq=False, kw_only=True)
class Effort(Config):
    """Effort of the search.

    Attributes:
        population: manoeuvres in a round, at least the eight that the next one is drawn from.
        rounds: how many.
        episodes: satellites drawn, that each manoeuvre of a round is flown on.
        flights: satellites drawn, for each of the final figures.
        seed: of the search.

    Raises:
        ValueError: a number is too small.
    """

    population: int = 48
    rounds: int = 10
    episodes: int = 8
    flights: int = 100
    seed: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_integer("population", self.population, low=_ELITE)
        for name in ("rounds", "episodes", "flights"):
            check_integer(name, getattr(self, name))
        check_integer("seed", self.seed, low=0)


def search(problem: Problem, request: Request, effort: Effort, progress: Progress) -> Waves:
    """Waves of the best manoeuvre for a problem, flown by what its actions are: body rates, or torque in open loop.

    Each round flies other tuning seeds; the last one's best and their mean are then judged by more.

    Args:
        problem: the satellite in its world; its horizon is the manoeuvre's duration.
        request: what to keep to.
        effort: how long to search.
        progress: is told of each round.
    """
    satellite = only_mission(problem).satellite
    authority = Authority.of(satellite, 0.5 * (request.duration - settling(problem.scenario)))
    rng = np.random.default_rng(effort.seed)
    mean, spread = _first_code(authority, request, problem.scenario.decision_period), _SPREAD

    def judged(code: np.ndarray, episodes: list[int]) -> np.ndarray:
        plans = manoeuvres(Waves.decoded(code, authority), request, problem, satellite)
        trials = fly_side_by_side(problem, [ManoeuvrePolicy(plan) for plan in plans], episodes)
        nominal = _pointing_cost(np.stack([plan.attitude for plan in plans]), request)
        return np.array([_cost(trial, request) for trial in trials]) + nominal

    for number in range(1, effort.rounds + 1):
        code = mean + spread * rng.standard_normal((effort.population, SIZE))
        cost = judged(code, seeds("tuning", effort.episodes, offset=number * effort.episodes))
        elite = code[np.argsort(cost)[:_ELITE]]
        mean, spread = elite.mean(axis=0), elite.std(axis=0) + _SPREAD_MIN
        progress(f"round {number} of {effort.rounds}")
    code = np.vstack([elite, mean])
    cost = judged(code, seeds("tuning", effort.flights, offset=(effort.rounds + 1) * effort.episodes))
    return Waves.decoded(code[[np.argmin(cost)]], authority)


def manoeuvres(waves: Waves, request: Request, problem: Problem, satellite: Satellite) -> list[Manoeuvre]:
    """The manoeuvre of each wave, for the nominal satellite."""
    period, decisions = problem.scenario.decision_period, problem.scenario.decisions
    edges = period * np.arange(decisions + 1)
    rates = waves.rates(edges, request.duration - settling(problem.scenario), request.returns)
    commands = 0.5 * (rates[:, 1:] + rates[:, :-1])
    J_free = satellite.inertia - satellite.wheels.rotor_inertia
    torque = wheel_torque(np.diff(rates, axis=1) @ J_free / period, satellite.wheels)
    turns = attitudes(rates, period)
    return [
        Manoeuvre(time=edges[:-1], rate=commands[k], torque=torque[k], attitude=turns[k, :-1])
        for k in range(len(commands))
    ]


def settling(world: Scenario) -> float:
    """s at the end that are left for coming to rest: whole decisions, in which nothing is commanded."""
    period = world.decision_period
    return period * max(1, math.ceil(_SETTLING / (world.tracking_bandwidth * period) - _ROUNDING))


def _first_code(authority: Authority, request: Request, period: float) -> np.ndarray:
    """Code in the middle of the first round: waves of a dozen reversals' time, or as short as turn limits want."""
    reversal = float((2.0 * authority.rate / authority.acceleration).max())
    wanted = 12.0 * reversal
    if request.turn_limit is not None:  # a square wave of rate a turns by a P / 4 about its middle
        wanted = min(wanted, 4.0 * request.turn_limit / float(authority.rate.max()))
    wanted = min(max(wanted, 4.0 * period), 0.5 * request.duration)
    return np.array([np.log(wanted), np.log(max(reversal, period)), *[-0.1] * 3, 0.0, 1.0 / 3.0, 2.0 / 3.0])


def _cost(trial: Trial, request: Request) -> float:
    beyond = np.maximum(trial.costs.mean(axis=0) - SLACK * request.cost_limit, 0.0).sum()
    known = np.minimum(trial.std[-1], 1.0)  # what ended early knows nothing
    touched = (trial.costs > 0.0).any(axis=1).mean()
    limits = _COST * beyond + _TOUCH * touched + _EARLY * trial.terminated.mean()
    return float(np.log(known).mean() + limits) + _POINTING * pointing_excess(trial, request)


def pointing_excess(trial: Trial, request: Request) -> float:
    """Angle by which the worst flight turns beyond the turn limit, or comes into a keep-out, rad."""
    turn = 0.0 if request.turn_limit is None else float(trial.turn.max()) - request.turn_limit
    return max(turn, -float(trial.clearance.min(initial=0.0)), 0.0)


def _pointing_cost(attitude: np.ndarray, request: Request) -> np.ndarray:
    """(K,) nats that nominal pointing (K, D, 4) beyond its limits, or near them, pays."""
    beyond = np.zeros(len(attitude))
    if request.turn_limit is not None:
        excess = turned(attitude) - max(request.turn_limit - _TURN_SLACK, 0.5 * request.turn_limit)
        beyond += np.maximum(excess.max(axis=1), 0.0)
    if request.keep_outs:
        near = np.array([k.angle for k in request.keep_outs]) + _TURN_SLACK
        beyond += np.maximum(near - separations(attitude, request.keep_outs), 0.0).max(axis=(1, 2))
    return _POINTING * beyond
