"""Performance bound of a cell of the benchmark, to which the comparison relates every policy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from baselines.studies.recording import record
from satid_gym.bounds import (
    envelope_bound,
    episode_bounds,
    population_bound,
    rate_cap,
    reference_limit,
    sample_information,
)
from satid_gym.estimators import MomentumEKFSettings
from satid_gym.estimators.inertia import PARAMETER_COUNT
from satid_gym.laws import InertiaLaw
from satid_gym.metrics import final_error
from satid_gym.policies.reference import ZeroPolicy
from satid_gym.problem import Problem, problem
from satid_gym.satellite import Satellite
from satid_gym.scenario import Scenario, prior_of
from satid_gym.sensors import Sensors
from satid_gym.tolerances import Tolerances

_WALKS = (0.0, *np.geomspace(1e-4, 0.01, 13).tolist())  # inertia walks of the reference limit's filter, per sqrt(s)


@dataclass(frozen=True, eq=False, kw_only=True)
class PerformanceBound:
    """Bounds on the relative error of the inertia at the D decisions of a cell, root mean square over its episodes.

    Attributes:
        bound: (D,) lower bound for every estimator, even one that knows the law, and every excitation inside the
            envelope.
        reference_limit: (D,) error of the cell's own filter if every sample gave the most information that the
            envelope allows; not a bound. For an AdaptiveEKF: of the MomentumEKF with the fixed inertia walk that is
            best for the cell and with known times of steps.
    """

    bound: np.ndarray
    reference_limit: np.ndarray

    def efficiency(self, error: np.ndarray) -> dict[str, float]:
        """Efficiencies of an error (D, N), from root mean squares over the final window.

        `efficiency` is bound / achieved, of policy and filter together. `excitation_efficiency` is reference_limit /
        achieved: it leaves out the cost of a filter's fixed inertia walk, which is the same for every policy, but
        includes the cost of the walk's estimation by an AdaptiveEKF.
        """
        achieved = _final(np.sqrt(np.square(error).mean(axis=1)))
        return {
            "efficiency": _final(self.bound) / achieved,
            "excitation_efficiency": _final(self.reference_limit) / achieved,
        }

    def series(self) -> dict[str, np.ndarray]:
        """Both errors (D,) by name."""
        return {"bound": self.bound, "reference_limit": self.reference_limit}

    def final_errors(self) -> dict[str, float]:
        """Both errors by name, root mean square over the final window."""
        return {name: _final(error) for name, error in self.series().items()}


def lacks_bound(posed: Problem) -> str:
    """Why a problem has no bounds, which take account of a rigid body, its gyro and tachometers; "" where it has."""
    sheet = posed.scenario.operate(posed.satellites[0])
    beyond = {
        f"the estimator {posed.estimator.name!r}": not isinstance(posed.estimator, MomentumEKFSettings),
        "panels or tanks": len(posed.satellites) > 1 or bool(sheet.oscillators),
        "sensors off nominal or a star tracker": sheet.sensors != Sensors(),
        "tolerances in the data sheet": sheet.tolerances != Tolerances(),
        "faults": posed.scenario.faults.possible,
    }
    return " and ".join(what for what, there in beyond.items() if there)


def performance_bound(
    satellite: str | Satellite, mode: str | InertiaLaw, chosen: Sequence[int], scenario: Scenario
) -> PerformanceBound:
    """Performance bound from the true trajectories of a cell's episodes.

    Raises:
        ValueError: there is something that the bounds take no account of, see `lacks_bound`.
    """
    posed = problem(satellite, mode, scenario)
    nominal, settings = posed.satellites[0], posed.estimator
    if beyond := lacks_bound(posed):
        raise ValueError(
            f"the bounds take no account of {beyond}, which satellite {nominal.name!r} has in scenario "
            f"{scenario.name!r}: take a scenario without"
        )
    assert isinstance(settings, MomentumEKFSettings)
    adaptive = settings.adaptive
    walks = _WALKS if adaptive else (settings.inertia_walk,)
    filters = [MomentumEKFSettings(parameters=settings.parameters, inertia_walk=walk) for walk in walks]
    recording = record(ZeroPolicy(), satellite=satellite, inertia=mode, seeds=chosen, scenario=scenario)
    motion, prior = recording.motion, prior_of(nominal, scenario)
    operated, static = scenario.operate(nominal), filters[0].replace(inertia_walk=0.0)
    bound = envelope_bound(motion, operated, prior, static, recording.dt, law_known=True)
    decisions = slice(scenario.samples, None, scenario.samples)
    cap = rate_cap(motion, operated, recording.dt)  # once for all filters: it takes longer than their equations
    information = sample_information(cap, motion.inertia, prior, PARAMETER_COUNT[posed.parameters])

    def limit(settings: MomentumEKFSettings) -> np.ndarray:
        error = reference_limit(
            motion, operated, prior, settings, recording.dt, finds_steps=adaptive, information=information
        )
        return np.sqrt(episode_bounds(error, motion.inertia).mean(axis=0))[decisions]

    return PerformanceBound(
        bound=np.sqrt(population_bound(bound, motion.inertia))[decisions],
        reference_limit=min((limit(settings) for settings in filters), key=_final),
    )


def _final(error: np.ndarray) -> float:
    """Root mean square of a series (D,) over the final window."""
    return float(np.sqrt(final_error(np.square(error)[:, None])[0]))
