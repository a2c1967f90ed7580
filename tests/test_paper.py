"""The paper's study: its data, its world, its scores, and a small run of all of it."""

import dataclasses
import json

import numpy as np
import pytest

from baselines.paper.exceedance import ekf_exceedances
from baselines.paper.figures import bars, horizon, pipeline, profiles
from baselines.paper.figures.pipeline import energy
from baselines.paper.flight import fly_profile
from baselines.paper.methods import METHODS, OUR_METHODS, estimate, wheel_acceleration
from baselines.paper.page import page
from baselines.paper.published import published
from baselines.paper.study import HORIZON_METHODS, HORIZONS, horizon_jobs, table_jobs
from baselines.paper.summary import MODES, CellScore, CellTable, cells, checks, finite
from baselines.paper.tables import number, static_table
from baselines.paper.world import prior, scenario
from satid_gym import SATELLITES, simulate
from satid_gym.laws import paper_law
from satid_gym.metrics import relative_error
from satid_gym.plants import law_inertia
from satid_gym.profiles import PROFILES
from satid_gym.satellite import BENCHMARK_SATELLITES
from tests.cases import cases


@pytest.fixture(scope="module")
def runs():
    """One seed of every cell."""
    return [run for job in table_jobs(1) for run in job.runs()]


@pytest.fixture(scope="module")
def found(runs):
    return cells(runs)


# data and world


def test_published_tables_are_whole():
    tables = published()
    assert len(tables) == 24 + 72
    assert {cell[0] for cell in tables} == set(PROFILES)
    assert {cell[1] for cell in tables} == set(BENCHMARK_SATELLITES)
    assert tables["multi_step", "smallsat", "static"] == {"ls": 0.97, "ekf": 0.15}
    assert tables["prbs", "smallsat", "drift"] == {"ls": 2.26, "ekf": 0.85}


def test_motor_noise_comes_out_at_five_percent():
    """Where the command leaves room; the lag makes neighbours alike by 1 - dt / (0.1 + dt)."""
    flight = fly_profile("microsat", "static", "sine", range(10))
    limit = SATELLITES["microsat"].wheels.max_torque[0]
    follow = 1.0 / 1.1
    expected = np.zeros_like(flight.commanded)
    last = np.zeros(3)
    for k, command in enumerate(flight.commanded):
        last = expected[k] = last + follow * (command - last)
    noise = flight.applied - expected[:, None]
    assert noise[20:].std() / limit == pytest.approx(0.05, rel=0.03)


def test_briefing_holds_no_truth():
    known = prior("cubesat")
    np.testing.assert_allclose(known.inertia, 0.80 * SATELLITES["cubesat"].inertia)
    np.testing.assert_allclose(prior("smallsat").inertia, 0.85 * SATELLITES["smallsat"].inertia)
    assert known.gyro_noise_std == pytest.approx(2e-6)
    assert known.disturbance_std == pytest.approx(1e-8)
    assert scenario(60.0).decisions == 60


def test_flight_is_the_simulators():
    """The same motor torques without noise, flown by `simulate`, give the same rates."""
    flight = fly_profile("microsat", "drift", "chirp", [0], 100.0)
    assert flight.gyro.shape == (101, 1, 3)
    truth = simulate(
        SATELLITES["microsat"], flight.applied[:, 0], flight.dt, law=paper_law("drift", 100.0), substeps=20
    )
    np.testing.assert_allclose(flight.rate[:, 0], truth.omega, atol=2e-6)
    np.testing.assert_allclose(flight.inertia[:, 0], truth.inertia, rtol=1e-12)
    np.testing.assert_allclose(wheel_acceleration(flight, 0)[1:], np.diff(flight.wheel_speed[:, 0], axis=0), atol=1e-12)


def test_energy_is_the_motors_work():
    """From rest, with no torque from outside: kinetic energy is the integral of torque times wheel speed."""
    flight = fly_profile("microsat", "static", "sine", [0], 40.0)
    body, wheels = energy(flight, 0)
    speed = flight.wheel_speed[:, 0]
    work = np.cumsum(np.sum(flight.applied[:, 0] * 0.5 * (speed[1:] + speed[:-1]), axis=1)) * flight.dt
    np.testing.assert_allclose((body + wheels)[1:], work, rtol=1e-3, atol=1e-6)


# scores


@cases(("mode", "low", "high"), [("step", 9.09, 9.10), ("drift", 4.30, 4.32), ("periodic", 1.8, 1.92)])
def test_perfect_constant_estimate_scores_what_the_paper_shows(mode, low, high):
    moments = np.array([3.0, 2.0, 4.0])
    truth = law_inertia(paper_law(mode), moments, np.arange(301.0))
    error = 100.0 * relative_error(np.diag(moments), truth)[1:][-60:].mean()
    assert low <= error <= high


def test_relative_error_by_hand():
    truth = np.diag([3.0, 4.0, 0.0])
    off_by_a_moment, off_by_a_product = truth + np.diag([0.0, 0.0, 1.0]), truth.copy()
    off_by_a_product[0, 1] = off_by_a_product[1, 0] = 1.0  # stands twice in the tensor
    found = relative_error(np.stack([off_by_a_moment, off_by_a_product]), truth)
    np.testing.assert_allclose(found, [0.2, 0.2 * np.sqrt(2.0)])


def test_numbers_print_with_three_digits():
    assert [number(x) for x in (10.98, 0.996, 0.5, 0.012345, float("nan"))] == [
        "10.98",
        "1.00",
        "0.500",
        "0.0123",
        "not identified",
    ]


def test_methods_can_be_chosen():
    flight = fly_profile("cubesat", "static", "chirp", [3], 60.0)
    assert list(estimate(flight, 0, ("momentum_ekf",))) == ["momentum_ekf"]
    every = estimate(flight, 0)
    assert set(every) == set(METHODS)
    assert every["ls"].condition > 1.0
    assert every["ekf"].condition is None
    assert every["momentum_rts"].inertia.shape == (61, 3)


def test_jobs_cover_the_study():
    assert len(table_jobs(2)) == 4 * 3 * 8
    assert len(horizon_jobs(2)) == (len(HORIZONS) - 1) * 3 * 8


# the study, with one seed


@pytest.mark.slow
def test_what_the_study_has_to_show(found):
    assert {check.claim: check.found for check in checks(found) if not check.met} == {}


def test_constant_plant_is_nearer_to_the_published_table(found):
    distance = {
        plant: np.median(
            [
                abs(c.mean / c.paper - 1.0)
                for c in found
                if c.plant == plant and c.method == "ls" and c.inertia_mode in MODES
            ]
        )
        for plant in ("varying", "constant")
    }
    assert distance["constant"] < 0.1 < distance["varying"]


def test_smoother_beats_the_filter_over_the_record(found):
    table = CellTable(found)
    for mode in MODES:
        for satellite in BENCHMARK_SATELLITES:
            filtered, smoothed = (
                np.mean([table(p, satellite, mode, method).record_mean for p in PROFILES])
                for method in ("momentum_ekf", "momentum_rts")
            )
            assert smoothed < filtered


@pytest.mark.slow
def test_page_figures_and_json(found, runs, tmp_path):
    static = [run for run in runs if run.inertia_mode == "static"]
    horizon_runs = [
        dataclasses.replace(run, horizon=horizon)
        for horizon in HORIZONS
        for run in static
        if run.method in HORIZON_METHODS
    ]
    profiles.draw(tmp_path)
    pipeline.draw(tmp_path, [0])
    bars.draw(tmp_path, found)
    horizon.draw(tmp_path, horizon_runs)
    for name in ("profiles", "pipeline", "static", "dynamic_varying", "dynamic_constant", "horizon"):
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000
        assert (tmp_path / f"{name}.pdf").stat().st_size > 5_000
    provenance = {"seeds": {"count": 1}, "command": "python -m baselines.paper", "revision": "x"}
    met = checks(found)
    text = page(found, horizon_runs, met, ekf_exceedances(found, [0]), provenance)
    for name in ("static", "dynamic_varying", "dynamic_constant", "horizon", "profiles", "pipeline"):
        assert f"({name}.png)" in text
    assert " nan" not in text
    assert len(static_table(found).splitlines()) == 2 + 24
    json.dumps(
        [{k: finite(v) if isinstance(v, float) else v for k, v in vars(c).items()} for c in found], allow_nan=False
    )


def test_what_is_not_identified_is_shown(found):
    lost = [dataclasses.replace(c, mean=float("nan")) if c.method in OUR_METHODS else c for c in found]
    assert static_table(lost).count("not identified") == 24 * len(OUR_METHODS)
    assert isinstance(lost[0], CellScore)
