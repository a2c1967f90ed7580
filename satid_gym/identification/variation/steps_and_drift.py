"""Variation of the inertia over time: whether it is constant, its steps and drift, and J(t) with its band."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from satid_gym.estimators.batch.regression import STD_MAX
from satid_gym.identification.estimate import Estimated, theta_sizes
from satid_gym.identification.variation.changes import Likelihood, Verdict, judge
from satid_gym.identification.variation.course import Course
from satid_gym.identification.variation.knots import Balance
from satid_gym.identification.variation.search import Search
from satid_gym.satellite import Satellite
from satid_gym.telemetry import Log

_LOOSE = 1e-4  # s^-1.5: drift that the noise is first found with
_MANIFOLD = 4.0  # of a moment as a constant: a satellite changes by less
_BUILDS_MAX = 24  # of the equations, after which no further step is tried
_TURNS_MAX = 3  # that the instant of a step is found again with what is known of the inertia since

Kind = Literal["constant", "steps", "drift", "steps and drift", "not told", "not explained"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Step:
    """A step of the inertia.

    Attributes:
        flight: number of the log, from 0, in which it occurred; of a step between flights, of the second one.
        time: s of the log's clock; NaN of a step between flights.
        time_std: s.
        jumped: whether the momentum jumped as well, as when a mass leaves with its own momentum.
        before: (6,) theta, kg m^2.
        after: (6,)
        change: (6,) after minus before.
        change_std: (6,)
    """

    flight: int
    time: float
    time_std: float
    jumped: bool
    before: np.ndarray
    after: np.ndarray
    change: np.ndarray
    change_std: np.ndarray


@dataclass(frozen=True, eq=False, kw_only=True)
class Variation:
    """Inertia over time, at knots, linear between them; NaN where the data do not identify it.

    Attributes:
        kind: result of the tests; "not told": the data are too few, and no step below a quarter would be found; "not
            explained": the data contradict a constant inertia, but the steps found are impossible for a satellite.
        p: share of simulations of a constant inertia that vary at least as much.
        detectable: relative step of the whole inertia that would be found half of the time.
        flight: (K,) number of the log.
        time: (K,) s of its clock; a step has two knots, the last before it and the first after it.
        theta: (K, 6) Jxx, Jyy, Jzz, Jxy, Jxz, Jyz, kg m^2.
        covariance: (K, 6, 6) covariance of each.
        steps: in order of time.
        doubted: (flight, s of its clock) of steps that are impossible for a satellite, where the momentum balance
            fails.
    """

    kind: Kind
    p: float
    detectable: float
    flight: np.ndarray
    time: np.ndarray
    theta: np.ndarray
    covariance: np.ndarray
    steps: tuple[Step, ...]
    doubted: tuple[tuple[int, float], ...] = ()

    @property
    def std(self) -> np.ndarray:
        """(K, 6)"""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))


def variation(
    logs: Sequence[Log],
    satellite: Satellite,
    window: float,
    estimated: Estimated,
    covariance: np.ndarray,
    shared: np.ndarray,
) -> Variation:
    """Inertia over time.

    Args:
        logs: one a flight.
        satellite: nominal.
        window: s.
        estimated: of a constant inertia.
        covariance: (6, 6) of it, (kg m^2)^2; NaN where the data tell nothing.
        shared: (6, 6) the part that all instants have in common, such as that of the rotors' inertia.
    """
    sizes = theta_sizes(satellite)
    search = Search(logs, satellite, window, estimated.fit.theta, estimated.delays.copy(), estimated.biases.copy(), {})
    rng = np.random.default_rng(0)
    drifts, walk, settled = True, _LOOSE, False
    tried: tuple[int, float] | None = None
    refused, turns = False, 0
    builds = 0
    while True:
        course, found = search.build(drifts, walk)
        verdict, builds = judge(found, course, rng), builds + 1
        if tried is not None:
            k = search.start(course, tried)
            if k is not None and turns < _TURNS_MAX and np.isfinite(tried[1]):
                turns, before, old = turns + 1, tried, search.steps.pop(tried)
                tried = search.add(found, course, k)
                if abs(tried[1] - before[1]) > old.std:
                    continue
                del search.steps[tried]
                search.steps[before], tried = old, before
            if k is None or _drifts_instead(found, course, k):
                del search.steps[tried]
                tried, refused, drifts, walk = None, True, True, _LOOSE
                continue
        tried, turns = None, 0
        if verdict.steps and builds < _BUILDS_MAX and not (refused and verdict.drifts):
            tried = search.add(found, course, int(verdict.step_gain.argmax()))
            drifts, walk, settled = False, 0.0, False
        elif settled:
            break
        else:
            drifts, settled = verdict.drifts, True
            walk = Likelihood(found, replace(course, drifts=drifts)).likeliest()[0]
    detectable = _detectable(Likelihood(found, course), verdict, estimated.fit.theta / sizes)
    course = _without_idle_steps(found, replace(course, drifts=drifts), verdict.step_limit)
    likelihood = Likelihood(found, course)
    x, spread = likelihood.estimate(likelihood.likeliest()[0])
    count = len(course.time)
    theta = x.reshape(-1, 6) * sizes
    whole = (spread * np.outer(np.tile(sizes, count), np.tile(sizes, count))).reshape(count, 6, count, 6)
    each = np.einsum("kikj->kij", whole) + shared
    if not course.starts and not drifts:
        theta, each = np.tile(estimated.fit.theta, (count, 1)), np.tile(covariance, (count, 1, 1))
    untold = ~(np.sqrt(np.einsum("kii->ki", each)) < STD_MAX * sizes) | np.isnan(np.diag(covariance))
    theta[untold] = np.nan
    each[untold[:, :, None] | untold[:, None, :]] = np.nan
    steps = []
    for k in course.starts:
        inside = course.flight[k - 1] == course.flight[k]
        flight = int(course.flight[k])
        instant = search.steps[flight, float(course.time[k]) if inside else -np.inf]
        change = whole[k, :, k] + whole[k - 1, :, k - 1] - whole[k, :, k - 1] - whole[k - 1, :, k]
        steps.append(
            Step(
                flight=flight,
                time=instant.time,
                time_std=instant.std,
                jumped=instant.jumped,
                before=theta[k - 1],
                after=theta[k],
                change=theta[k] - theta[k - 1],
                change_std=np.where(untold[k] | untold[k - 1], np.nan, np.sqrt(np.diag(change))),
            )
        )
    doubted = tuple(
        (step.flight, step.time) for step in steps if not is_of_a_satellite(step, estimated.fit.theta, covariance)
    )
    if doubted:
        theta[:], each[:], steps = np.nan, np.nan, []
    return Variation(
        kind="not explained" if doubted else _kind(bool(steps), drifts, detectable),
        p=judge(found, replace(course, starts=()), rng).p if course.starts else verdict.p,
        detectable=detectable,
        flight=course.flight,
        time=course.time,
        theta=theta,
        covariance=each,
        steps=tuple(steps),
        doubted=doubted,
    )


def is_of_a_satellite(step: Step, constant: np.ndarray, covariance: np.ndarray) -> bool:
    """Whether a step is identified as fully as a constant inertia, and no moment changes by a large factor."""
    told = np.isfinite(np.diag(covariance))
    if not np.isfinite(step.change_std[told]).all():
        return False
    moments = np.array([step.before[:3], step.after[:3]])[:, told[:3]] / constant[:3][told[:3]]
    return bool(((moments > 1.0 / _MANIFOLD) & (moments < _MANIFOLD)).all())


def _drifts_instead(found: Balance, course: Course, k: int) -> bool:
    """Whether a drift explains the data better than the step before knot k, with or without a drift."""
    starts = tuple(start for start in course.starts if start != k)
    without = Likelihood(found, replace(course, starts=starts, drifts=True)).criterion()
    return without < min(Likelihood(found, replace(course, drifts=drifts)).criterion() for drifts in (False, True))


def _without_idle_steps(found: Balance, course: Course, limit: float) -> Course:
    """Course without the steps at which only the momentum jumped."""
    for k in course.starts:
        fewer = replace(course, starts=tuple(start for start in course.starts if start != k))
        if Likelihood(found, course).likeliest()[1] - Likelihood(found, fewer).likeliest()[1] <= limit:
            course = fewer
    return course


def _detectable(likelihood: Likelihood, verdict: Verdict, level: np.ndarray) -> float:
    """Fraction by which the whole inertia has to step for a chance of one half, at the median instant."""
    power = [
        float(((basis.T @ (likelihood.step_rows(k) @ level)) ** 2).sum())
        for k, basis in enumerate(likelihood.step_directions())
        if basis.shape[1]
    ]
    return float(np.sqrt(verdict.step_limit * likelihood.scale() / np.median(power))) if power else np.inf


def _kind(steps: bool, drifts: bool, detectable: float) -> Kind:
    if steps:
        return "steps and drift" if drifts else "steps"
    if drifts:
        return "drift"
    return "constant" if detectable < STD_MAX else "not told"
