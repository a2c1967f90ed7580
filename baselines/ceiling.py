"""What a cell of the benchmark allows, for the comparison to set every policy against."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from baselines.recording import record
from satid_gym.bounds import envelope_bound, ideal_error, population_bound
from satid_gym.estimators.settings import AdaptiveEKFSettings, MomentumEKFSettings, RateEKFSettings, brief
from satid_gym.laws import InertiaLaw
from satid_gym.metrics import final_error
from satid_gym.policies.reference import ZeroPolicy
from satid_gym.problem import problem
from satid_gym.satellite import Satellite
from satid_gym.scenario import Scenario

_WALKS = (0.0, *np.geomspace(1e-4, 0.01, 13).tolist())  # per sqrt(s)


@dataclass(frozen=True, eq=False, kw_only=True)
class Ceiling:
    """Relative errors of the inertia at the D decisions of a cell, root mean square over its episodes.

    Attributes:
        bound: (D,) no estimator beats it, not one that knows the law, under any excitation in the envelope.
        ideal: (D,) the cell's own filter if every sample told as much as the envelope allows; not a bound. For an
            AdaptiveEKF: a MomentumEKF of the fixed walk that serves the cell best, told when the inertia steps.
    """

    bound: np.ndarray
    ideal: np.ndarray

    def efficiency(self, error: np.ndarray) -> dict[str, float]:
        """An error (D, N) set against both, by root mean square over the final window.

        `efficiency` is bound / achieved, of policy and filter together; `excitation_efficiency` is ideal / achieved,
        which leaves out what the tuning of a filter with one walk costs every policy alike; what an AdaptiveEKF gives
        for finding out the walk stays in it.
        """
        achieved = _final(np.sqrt(np.square(error).mean(axis=1)))
        return {"efficiency": _final(self.bound) / achieved, "excitation_efficiency": _final(self.ideal) / achieved}

    def final_errors(self) -> dict[str, float]:
        """Root mean square over the final window of `bound` and `ideal`."""
        return {"bound": _final(self.bound), "ideal": _final(self.ideal)}


def ceiling(satellite: str | Satellite, mode: str | InertiaLaw, chosen: Sequence[int], scenario: Scenario) -> Ceiling:
    """What the truths of a cell's episodes allow.

    Raises:
        ValueError: the scenario's filter is neither the MomentumEKF nor the AdaptiveEKF.
    """
    posed = problem(satellite, mode, scenario)
    (nominal,), settings = posed.satellites, posed.estimator
    if isinstance(settings, RateEKFSettings):
        raise ValueError(f"bounds are for the MomentumEKF's model; scenario {scenario.name!r} has {settings.name!r}")
    adaptive = isinstance(settings, AdaptiveEKFSettings)
    walks = _WALKS if adaptive else (settings.inertia_walk,)
    filters = [MomentumEKFSettings(parameters=settings.parameters, inertia_walk=walk) for walk in walks]
    recording = record(ZeroPolicy(), satellite=satellite, inertia=mode, seeds=chosen, scenario=scenario)
    course, briefing = recording.course, brief(nominal, scenario)
    operated, static = scenario.operate(nominal), filters[0].replace(inertia_walk=0.0)
    bound = envelope_bound(course, operated, briefing, static, recording.dt, law_known=True)
    decisions = slice(scenario.samples, None, scenario.samples)

    def ideal(settings: MomentumEKFSettings) -> np.ndarray:
        error = ideal_error(course, operated, briefing, settings, recording.dt, finds_steps=adaptive)
        relative = error.sum(axis=2) / np.square(course.inertia).sum(axis=(2, 3))
        return np.sqrt(relative.mean(axis=0))[decisions]

    return Ceiling(
        bound=np.sqrt(population_bound(bound, course.inertia))[decisions],
        ideal=min((ideal(settings) for settings in filters), key=_final),
    )


def _final(error: np.ndarray) -> float:
    """Root mean square of a series (D,) over the final window."""
    return float(np.sqrt(final_error(np.square(error)[:, None])[0]))
