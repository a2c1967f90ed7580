"""Sampling, size and horizon: what the filter takes from its prior for them, and that it stays consistent."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from baselines.studies.consistency import ConsistencyStudy, cell
from baselines.studies.consistency import main as consistency_main
from baselines.studies.worlds.catalogue import WORLDS
from baselines.studies.worlds.policies import policy_for
from baselines.studies.worlds.satellites import OBSERVATORY
from satid_gym import SATELLITES, SCENARIOS, Scenario
from satid_gym.estimators import AdaptiveEKF, MomentumEKFSettings
from satid_gym.evaluation import fly, seeds
from satid_gym.policies.registry import make_baseline
from satid_gym.satellite import BENCHMARK_SATELLITES
from satid_gym.scenario import prior_of
from tests.cases import cases


def test_what_a_prior_says_of_motion_between_two_readings(microsat):
    """Three wheels of 2e-3 * 900 N m s, a fifth of that at the start; 5 % of 0.1 N m on 6.53 kg m^2 for 0.1 s."""
    prior = prior_of(microsat, Scenario())
    body = 6.53 * 0.02 * 0.03
    assert prior.nutation == pytest.approx(np.hypot(np.sqrt(3.0) * 0.36, body) * 0.1 / 4.53, rel=1e-12)
    assert prior.agitation == pytest.approx(0.005 * 0.1 / 6.53, rel=1e-12)
    later = prior_of(microsat, Scenario(sample_period=1.0, torque_noise=0.1))
    assert later.nutation == pytest.approx(10.0 * prior.nutation)
    assert later.agitation == pytest.approx(20.0 * prior.agitation)


def test_scenarios_take_one_substep_in_errors_of_the_momentum_or_of_the_rate_where_motors_shake_little():
    settings = MomentumEKFSettings()
    for scenario in SCENARIOS.values():
        for satellite in scenario.equip([SATELLITES[name] for name in BENCHMARK_SATELLITES]):
            prior = prior_of(satellite, scenario)
            quiet = scenario.name == "operations"  # its motors are five times as quiet as the others'
            assert (settings.steps(prior), settings.updates_rate(prior)) == (1, quiet), (scenario.name, satellite.name)


@cases("period", [0.02, 0.1, 1.0, 4.0])
@cases("name", list(BENCHMARK_SATELLITES))
@pytest.mark.compiled
def test_a_prediction_is_off_by_less_than_a_reading_tells(name, period):
    """Torque-free, with the momentum that the prior expects, against Euler's equations integrated apart."""
    satellite = SATELLITES[name]
    prior = prior_of(satellite, Scenario(sample_period=period, decision_period=max(1.0, period)))
    ekf, wheels = AdaptiveEKF(parameters="full"), satellite.wheels
    speed = 0.2 * wheels.max_speed * np.array([1.0, -1.0, 1.0]) / np.sqrt(3.0)
    rate = 0.2 * satellite.rate_limit * np.array([1.0, 1.0, -1.0])
    ekf.reset(prior, rate, speed)
    momentum = satellite.inertia @ rate + wheels.inertia * speed

    def slope(_, m):
        return np.cross(m, np.linalg.solve(satellite.inertia, m - wheels.inertia * speed))

    exact = solve_ivp(slope, (0.0, period), momentum, rtol=1e-12, atol=1e-14).y[:, -1]
    ekf.predict(speed, period)
    told = prior.gyro_noise_std * np.diag(satellite.inertia).min()
    assert np.abs(ekf.mean[:3] - exact).max() < told


def nees(satellite, inertia, policy, scenario, **estimator) -> float:
    flight = fly(
        policy,
        satellite=satellite,
        inertia=inertia,
        seeds=seeds("validation", 20),
        scenario=scenario,
        estimator={"name": "adaptive", **estimator},
    )
    return float(flight.scores()["nees"].mean())


@pytest.mark.compiled
def test_a_filter_that_is_sampled_coarsely_is_consistent():
    """One substep a second is not enough: each leaves an error that readings do not explain."""
    coarse = {"sample_period": 1.0}
    policy = make_baseline("rate_square", "smallsat")
    assert 0.3 < nees("smallsat", "static", policy, coarse) < 2.0
    assert nees("smallsat", "static", policy, coarse, substeps=1) > 3.0


@pytest.mark.compiled
def test_a_body_that_motors_hardly_shake_is_updated_in_errors_of_its_rate():
    """Ten tonnes a square metre, wheels of 0.2 N m: where errors of the momentum go astray."""
    policy = policy_for("multi_step", OBSERVATORY, Scenario())
    assert 0.3 < nees(OBSERVATORY, "periodic", policy, "default") < 2.0
    assert nees(OBSERVATORY, "periodic", policy, "default", rate_coordinates=False) > 4.0


def test_a_satellite_that_is_flown_slower_does_not_get_what_was_tuned_for_its_name():
    """At 0.5 deg/s in place of 0.05 rad/s; a sine of 0.01 Hz then reaches a quarter of the limit, after 50 s."""
    own = SATELLITES["cubesat"]
    slow = own.replace(rate_limit=np.deg2rad(0.5))
    assert slow in WORLDS["tracker to 1 deg/s, flown to 0.5 deg/s, scale 0.1 %"].satellites
    tuned, slower = (policy_for("sine", satellite, Scenario()).amplitude for satellite in (own, slow))
    assert tuned == make_baseline("sine", "cubesat").amplitude
    reached = slower * np.min(slow.wheels.max_torque) * 50.0 / np.mean(np.diag(slow.inertia))
    assert reached == pytest.approx(0.25 * slow.rate_limit)
    assert slower < 0.25 * tuned


@cases("world", ["no torque noise", "horizon 30 s"])
@pytest.mark.compiled
def test_where_little_shows_that_the_inertia_varies_a_larger_first_walk_keeps_the_filter_consistent(world):
    own, default = (
        cell(ConsistencyStudy(episodes=48, tuned=tuned), world, "multi_step", SATELLITES["cubesat"], "periodic")["nees"]
        for tuned in (True, False)
    )
    assert 0.3 < own < 2.0
    assert default > 2.3


def test_open_loop_signals_by_rates_are_not_those_that_were_tuned_as_torques():
    satellite, world = SATELLITES["cubesat"], WORLDS["friction 1 of 10 mN m, by rates"]
    assert policy_for("sine", satellite, Scenario(), world.control).amplitude == 0.95
    assert policy_for("sine", satellite, Scenario()).amplitude < 0.5


def test_a_study_adds_rows_to_a_file_and_keeps_the_others(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("baselines.command.provenance.revision", lambda _: "a1")
    file, small = tmp_path / "consistency.json", {"policies": ("zero",), "inertias": ("static",), "episodes": 2}
    assert (
        consistency_main(
            ConsistencyStudy(worlds=("1 kg m^2", "as nominal"), satellites=("cubesat",), output=file, **small)
        )
        == 0
    )
    first = json.loads(file.read_text())
    monkeypatch.setattr("baselines.command.provenance.revision", lambda _: "b2")
    again = ConsistencyStudy(
        worlds=("1 kg m^2", "horizon 30 s"), satellites=("cubesat",), output=file, merge=True, **small
    )
    assert consistency_main(again) == 0
    both = json.loads(file.read_text())
    assert [cell["world"] for cell in both["cells"]] == ["as nominal", "1 kg m^2", "horizon 30 s"]
    flown = {cell["world"]: cell for cell in first["cells"]}
    assert both["cells"][:2] == [flown["as nominal"], {**flown["1 kg m^2"], "revision": "b2"}]
    capsys.readouterr()
