"""Open-loop D-optimal design by the cross-entropy method: `python -m baselines.tuning.open_loop_design`.

Plans are judged on the nominal satellite by the posterior bound's mean log det over the flight: what a filter with
the planners' walk would know. Then the share of the rate limit to aim at is chosen on the tuning seeds by the rule
of `python -m baselines.tune`, for an open loop has to leave room for motor noise and unknown inertia.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from baselines.command import cli
from baselines.command.provenance import result_head
from baselines.tuning.amplitudes import Trial, best, idle, judge
from baselines.tuning.prepared import check_output, definitions, merged
from satid_gym.bounds import TrueMotion, posterior_bound
from satid_gym.config import check_integer, check_number
from satid_gym.control.planning.planner import planning_walk
from satid_gym.estimators import MomentumEKFSettings
from satid_gym.evaluation import benchmark_scenario, fly, seeds
from satid_gym.files import check_writable, write_json
from satid_gym.policies.open_loop_optimal import DESIGNS, OpenLoopOptimalPolicy, planned_rates
from satid_gym.resolution import ScenarioLike
from satid_gym.satellite import BENCHMARK_SATELLITES, Satellite
from satid_gym.scenario import Scenario, prior_of
from satid_gym.selection import select_satellites, select_scenarios

FRACTIONS = [0.05, 0.065, 0.08, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9]  # of the rate limit


@dataclass(frozen=True, kw_only=True)
class Design:
    """How to search, and where to keep what is found."""

    population: int = 64
    """Plans tried in a round."""
    elite: int = 10
    """Best plans, from which the next round is drawn."""
    rounds: int = 25
    """How many rounds."""
    reversals: int = 40
    """Most reversals of an axis."""
    fraction: float = 0.5
    """Share of the rate limit that the plans aim at while they are designed."""
    seed: int = 0
    """Seed of the search."""
    episodes: int = 100
    """Tuning episodes that judge a share of the rate limit."""
    scenarios: tuple[str, ...] = ("default", "tight", "paper")
    """Scenarios to design for: names, .json or .toml files, or module:name (runs the module's code)."""
    satellites: tuple[str, ...] = BENCHMARK_SATELLITES
    """Satellites to design for: names, .json or .toml files, or module:name (runs the module's code)."""
    output: Path = DESIGNS
    """JSON file that the policy reads, other entries of which stay; another one is taken by the option --designs of
    other commands."""

    def check(self) -> None:
        """Refuse what cannot be designed.

        Raises:
            ValueError: a name is unknown or taken by another, what a file holds is not valid, a number is out of
                range, or a custom design would be written among the shipped ones.
            DamagedFileError: the output is a file of something else.
        """
        check_output(self.satellites, self.scenarios, self.output, DESIGNS)
        for name in ("population", "rounds", "reversals", "episodes"):
            check_integer(name, getattr(self, name))
        check_integer("elite", self.elite, high=self.population)
        check_integer("seed", self.seed, low=0)
        check_number("fraction", self.fraction, strict=True, high=1.0)


def nominal_motion(rates: np.ndarray, satellite: Satellite, samples: int) -> TrueMotion:
    """Truth of the nominal satellite with rates (N, D + 1, 3) at the decisions' edges and zero momentum."""
    ramp = np.arange(samples)[:, None] / samples
    between = rates[:, :-1, None] + ramp * np.diff(rates, axis=1)[:, :, None]
    fine = np.concatenate([between.reshape(len(rates), -1, 3), rates[:, -1:]], axis=1)
    wheels = satellite.wheels
    still = np.zeros_like(fine)
    return TrueMotion(
        momentum=still,
        rate=fine,
        wheel_speed=-fine @ satellite.inertia @ np.linalg.pinv(wheels.axes).T / wheels.inertia,
        inertia=np.broadcast_to(satellite.inertia, (*fine.shape, 3)),
        torque=still,
    )


def information(dwell: np.ndarray, satellite: Satellite, scenario: Scenario, fraction: float) -> np.ndarray:
    """Nats by which a filter of the `planning_walk` knows the nominal satellite's inertia better than before launch.

    Mean over the flight of 1/2 log(det P of the prior / det P), (N,) for plans (N, 3, K).
    """
    prior, settings = prior_of(satellite, scenario), MomentumEKFSettings(inertia_walk=planning_walk(scenario.estimator))
    operated = scenario.operate(satellite)
    rates = planned_rates(dwell, operated, fraction, scenario.decisions, scenario.decision_period)
    motion = nominal_motion(rates, operated, scenario.samples)
    covariance = posterior_bound(motion, prior, settings, scenario.sample_period)
    log_prior = 2.0 * np.log(prior.prior_theta_std(prior.needed_parameters)).sum()
    return 0.5 * (log_prior - np.linalg.slogdet(covariance)[1].mean(axis=1))


def search(satellite: Satellite, scenario: Scenario, design: Design) -> tuple[np.ndarray, float]:
    """Best plan (3, K) found, and its information, nats."""
    rng = np.random.default_rng(design.seed)
    shape = (3, design.reversals)
    mean, std = np.full(shape, np.log(15.0)), np.full(shape, 0.6)  # of the logarithm of a dwell
    found: tuple[np.ndarray, float] = (np.ones(shape), -np.inf)
    for _ in range(design.rounds):
        logs = mean + std * rng.standard_normal((design.population, *shape))
        dwell = np.maximum(np.round(np.exp(logs)), 1.0)
        value = information(dwell, satellite, scenario, design.fraction)
        order = np.argsort(-value)[: design.elite]
        mean, std = logs[order].mean(axis=0), logs[order].std(axis=0) + 0.02
        if value[order[0]] > found[1]:
            found = dwell[order[0]], float(value[order[0]])
    return found


def fit(dwell: list[list[int]], satellite: Satellite, scenario: ScenarioLike, episodes: int) -> Trial:
    """The share of the rate limit that the rule of tuning chooses for a plan."""
    cell = {"satellite": satellite, "inertia": "random", "seeds": seeds("tuning", episodes)}
    trials = []
    for fraction in FRACTIONS:
        policy = OpenLoopOptimalPolicy(dwell, fraction)
        flight = fly(policy, scenario=benchmark_scenario(scenario), **cell)  # type: ignore[arg-type]
        trials.append(judge({"fraction": fraction}, flight))
    return best(trials, idle(satellite, scenario, episodes))


def run(design: Design) -> dict[str, Any]:
    """Design and fit everything: the contents of the JSON file."""
    entries = []
    scenarios, satellites = select_scenarios(design.scenarios), select_satellites(design.satellites)
    cells = [(scenario, satellite) for scenario in scenarios for satellite in satellites]
    for scenario, satellite in tqdm(cells, desc="designing", unit="plan"):
        plan, value = search(satellite, scenario, design)
        last = np.searchsorted(np.cumsum(plan, axis=1).min(axis=0), scenario.decisions)
        dwell = plan[:, : last + 1].astype(int).tolist()
        chosen = fit(dwell, satellite, scenario, design.episodes)
        entries.append(
            {
                "satellite": satellite.name,
                "scenario": scenario.name,
                "information_nats": value,
                **chosen.settings,
                "final_error": chosen.final_error,
                "outside_fraction": chosen.outside_fraction,
                "saturated_fraction": chosen.saturated_fraction,
                "inside": chosen.inside,
                "dwell": dwell,
                "episodes": design.episodes,
            }
        )
    settings = {
        **dataclasses.asdict(design),
        "scenarios": [scenario.name for scenario in scenarios],
        "satellites": [satellite.name for satellite in satellites],
        "output": design.output.name,
    }
    return {
        **result_head("baselines.tuning.open_loop_design", settings),
        "definitions": definitions(satellites, scenarios),
        "entries": entries,
    }


def main(settings: Design) -> int:
    """Design what the command line asks for; the exit code."""
    check_writable(settings.output.parent)
    results = run(settings)
    write_json(settings.output, merged(settings.output, results))
    for entry in results["entries"]:
        print(
            f"{entry['scenario']:8s} {entry['satellite']:9s} {entry['information_nats']:.2f} nats, rates up to "
            f"{entry['fraction']:.0%} of the limit: final error {100 * entry['final_error']:.2f} %, "
            f"outside {100 * entry['outside_fraction']:.1f} % of the time"
        )
    return 0


if __name__ == "__main__":
    cli.run(main)
