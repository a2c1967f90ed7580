"""Products of inertia: the default filter estimates them where there are any, and who asks it not to is refused."""

from __future__ import annotations

import re

import numpy as np
import pytest

from agents.benchmark.report.episode import fly_episode
from agents.docs.readme import ROOT
from baselines.studies.performance_bound import performance_bound
from baselines.tuning.amplitudes import attempt
from baselines.tuning.open_loop_design import information
from satid_gym import SATELLITES, InertiaLaw, Satellite, SatInertiaIDEnv, SatInertiaIDVectorEnv
from satid_gym.estimators import (
    AdaptiveEKF,
    FilterpyAdaptiveEKF,
    FilterpyMomentumEKF,
    FilterpyMomentumUKF,
    FilterpyRateEKF,
    MomentumEKF,
    MomentumEKFSettings,
    RateEKF,
)
from satid_gym.estimators.inertia import PRODUCT_MIN
from satid_gym.evaluation import Flight, benchmark_scenario, fly, seeds
from satid_gym.policies.learned.shipped import find
from satid_gym.policies.registry import build
from satid_gym.policy import missions
from satid_gym.problem import problem
from satid_gym.scenario import prior_of
from satid_gym.scenario_catalogue import SCENARIOS
from tests.cases import cases

RATE_SQUARE = {"period": 24.0, "margin": 2.75}


def with_product(share: float, **changes: object) -> Satellite:
    """Microsat with a product of inertia Jxy of `share` of the geometric mean of Jxx and Jyy."""
    inertia = SATELLITES["microsat"].inertia.copy()
    inertia[0, 1] = inertia[1, 0] = share * np.sqrt(inertia[0, 0] * inertia[1, 1])
    return SATELLITES["microsat"].replace(name="tilted", inertia=inertia, **changes)


TILTED = with_product(0.1)
DEPLOYED = InertiaLaw("step", change=[[0.2, 0.0, 0.1], [0.0, 0.2, 0.0], [0.1, 0.0, 0.3]])
PRODUCTS = {
    "satellite": ({"satellite": TILTED}, "satellite 'tilted' has products of inertia .*, Jxy = 0.6238 kg m"),
    "one of several": ({"satellite": ["microsat", TILTED]}, "satellite 'tilted' has products of inertia"),
    "law": ({"inertia": DEPLOYED}, "the inertia law's change has products of inertia .*, Jxz = 0.1 kg m"),
    "scenario": ({"scenario": {"tilt_std": 0.05}}, "the scenario tilts the principal axes .*, tilt_std = 0.05"),
}


def flown(satellite: Satellite, inertia: str | InertiaLaw = "static") -> Flight:
    policy = build("rate_square", RATE_SQUARE)
    chosen = seeds("validation", 4)
    return fly(policy, satellite=satellite, inertia=inertia, seeds=chosen, scenario=benchmark_scenario())


@cases("inertia", ["static", DEPLOYED])
def test_the_default_filter_knows_a_tilted_satellite_and_how_well(inertia):
    scores = flown(TILTED, inertia).scores()
    assert scores["final_error"].max() < 0.005
    assert 0.1 < scores["nees"].mean() < 3.0


def test_a_law_that_changes_products_of_inertia_is_followed_on_a_satellite_without():
    scores = flown(SATELLITES["microsat"], DEPLOYED).scores()
    assert scores["final_error"].max() < 0.005
    assert 0.1 < scores["nees"].mean() < 3.0


def test_the_satellite_of_the_page_on_your_own_is_identified():
    blocks = re.findall(r"^```python\n(.*?)^```$", (ROOT / "docs/extend.md").read_text(), flags=re.DOTALL | re.M)
    (block,) = [block for block in blocks if "corners" in block]
    namespace: dict[str, object] = {}
    exec(compile(block, "extend.md", "exec"), namespace)
    scores = flown(namespace["satellite"]).scores()
    assert scores["final_error"].max() < 0.005
    assert 0.1 < scores["nees"].mean() < 3.0


def test_a_product_too_small_to_matter_leaves_the_filter_of_three_moments_consistent():
    small = with_product(0.99 * PRODUCT_MIN)
    assert problem(small).parameters == "principal"
    assert problem(with_product(1.01 * PRODUCT_MIN)).parameters == "full"
    assert 0.1 < flown(small).scores()["nees"].mean() < 1.5


def test_tuning_a_tilted_satellite_flies_the_filter_that_it_needs():
    assert attempt("rate_square", RATE_SQUARE, TILTED, "default", episodes=4).final_error < 0.005


# Which parameters


@cases("name", ["adaptive", "momentum", "rate"])
@cases(("given", "message"), PRODUCTS.values())
def test_products_of_inertia_make_the_parameters_full_and_principal_ones_an_error(given, message, name):
    assert problem(**given, estimator=name).parameters == "full"
    assert problem(**given, estimator={"name": name, "parameters": "full"}).parameters == "full"
    way_out = f'estimator={{"name": "{name}", "parameters": "full"}}, or without parameters'
    with pytest.raises(ValueError, match=f"{message}.*{re.escape(way_out)}"):
        problem(**given, estimator={"name": name, "parameters": "principal"})


def test_moments_alone_are_estimated_where_there_is_nothing_else():
    law = InertiaLaw("step", change=(0.2, 0.2, 0.3))
    for given in ({}, {"satellite": "random"}, {"inertia": law}, {"scenario": "paper"}, {"scenario": "faults"}):
        assert problem(**given).parameters == "principal"
    assert problem(estimator={"name": "adaptive", "parameters": "full"}).parameters == "full"


@cases("option", [{"satellite": TILTED}, {"true_inertia": TILTED.inertia}, {"inertia": DEPLOYED}])
def test_products_that_come_with_a_reset_are_refused_under_three_moments(option):
    env, vector = SatInertiaIDEnv(), SatInertiaIDVectorEnv(2)
    env.reset(seed=0)
    for refused in (env.reset, vector.reset):
        with pytest.raises(ValueError, match=r'has products of inertia.*"parameters": "full"'):
            refused(options=option)
    env.step(np.zeros(3))  # the episode under way goes on
    full = SatInertiaIDEnv(estimator={"name": "adaptive", "parameters": "full"})
    _, info = full.reset(seed=0, options=option)
    assert np.isfinite(info["nees"])


# Estimators that are objects


FILTERS = (AdaptiveEKF, MomentumEKF, RateEKF, FilterpyAdaptiveEKF, FilterpyMomentumEKF, FilterpyMomentumUKF)
FILTERS += (FilterpyRateEKF,)


@cases("kind", FILTERS)
def test_a_filter_takes_from_the_briefing_what_the_satellite_needs(kind):
    tilting = SCENARIOS["default"].replace(tilt_std=0.05)
    for satellite, scenario, p in (
        ("microsat", SCENARIOS["default"], 3),
        (TILTED, SCENARIOS["default"], 6),
        ("microsat", tilting, 6),
    ):
        estimator = kind()
        estimator.reset(prior_of(SATELLITES.get(satellite, TILTED), scenario), np.zeros(3), np.zeros(3))
        assert len(estimator.mean) == p + 6
    estimator = kind(parameters="principal")
    estimator.reset(prior_of(TILTED, SCENARIOS["default"]), np.zeros(3), np.zeros(3))
    assert len(estimator.mean) == 9


@pytest.mark.interpreted
@cases("kind", [MomentumEKF, FilterpyMomentumEKF, FilterpyRateEKF])
def test_a_plugged_in_filter_estimates_what_its_environment_needs(kind):
    estimator = kind()
    env = SatInertiaIDEnv(["microsat", TILTED], estimator=estimator)
    for seed in range(6):  # either satellite
        env.reset(seed=seed)
        env.step(np.full(3, 0.1))
        assert len(estimator.mean) == 12
    with pytest.raises(ValueError, match="has products of inertia"):
        SatInertiaIDEnv(TILTED, estimator=kind(parameters="principal"))


def test_a_plugged_in_filter_must_say_what_it_estimates():
    class Silent(MomentumEKF):
        parameters = "moments"

    with pytest.raises(ValueError, match="unknown parameters of the estimator 'moments'"):
        SatInertiaIDEnv(estimator=Silent())


# What follows the filter


def test_policies_are_told_the_parameters_that_are_flown():
    (mission,) = missions(problem(TILTED))
    assert mission.estimator.parameters == "full"
    assert mission.layout["inertia"].stop - mission.layout["inertia"].start == 6


@pytest.mark.slow
@pytest.mark.parametrize("estimator", [None, "rate"])
def test_a_planner_flies_a_tilted_satellite_under_any_filter(estimator):
    flight = fly(
        build("greedy", {}),
        satellite=TILTED,
        inertia="static",
        seeds=seeds("validation", 2),
        scenario=benchmark_scenario().replace(horizon=40.0),
        estimator=estimator,
    )
    assert flight.alive.all()
    assert np.isfinite(flight.error).all()


def test_a_learned_policy_says_that_it_was_trained_for_fewer_parameters():
    (mission,) = missions(problem(TILTED, include_covariance=True))
    with pytest.raises(ValueError, match="as many wheels and inertia parameters as the one it was trained on"):
        find("generalist").reset(mission, [0])


def test_an_open_loop_is_designed_for_all_that_the_filter_estimates():
    scenario = benchmark_scenario().replace(horizon=40.0)
    dwell = np.full((2, 3, 8), 5.0) * np.array([1.0, 1.6])[:, None, None]
    assert np.all(information(dwell, TILTED, scenario, 0.5) > 0.0)
    assert np.all(information(dwell, TILTED, scenario, 0.5) > information(dwell, SATELLITES["microsat"], scenario, 0.5))


def test_a_tilted_satellite_has_a_ceiling_and_a_page(monkeypatch):
    """What the comparison and the report do with a satellite that was added to the project's."""
    monkeypatch.setitem(SATELLITES, "tilted", TILTED)
    scenario = benchmark_scenario().replace(horizon=40.0)
    allowed = performance_bound("tilted", "periodic", seeds("validation", 2), scenario).final_errors()
    assert 0.0 < allowed["bound"] < allowed["reference_limit"] < 0.1
    policy = build("rate_square", RATE_SQUARE)
    page = fly_episode([policy], satellite="tilted", mode="step", seed=seeds("test", 1)[0], scenario=scenario)
    (flight,) = page["flights"]
    assert np.shape(page["inertia"]) == (3, len(page["time"]))
    for name in ("estimate", "sigma"):
        assert np.shape(flight[name]) == (3, len(page["time"]))
    assert flight["error"][-1] < 0.05


def test_a_tilted_satellite_is_drawn():
    pytest.importorskip("pygame")
    env = SatInertiaIDEnv(TILTED, render_mode="rgb_array", render_size=240)
    env.reset(seed=0)
    for _ in range(3):
        env.step(np.full(3, 0.2))
    assert env.render().shape == (240, 240, 3)


def test_settings_without_parameters_are_plain_values():
    assert MomentumEKFSettings().to_dict()["parameters"] is None
    assert MomentumEKFSettings.from_dict(MomentumEKFSettings().to_dict()) == MomentumEKFSettings()
