"""Errors of gyro and wheels: how truth draws them, and how the filter estimates them with the inertia."""

import json

import numpy as np
import pytest

from baselines.studies.consistency import ConsistencyStudy
from baselines.studies.consistency import main as consistency_main
from baselines.studies.recording import record
from baselines.studies.worlds.catalogue import WORLDS
from satid_gym import SATELLITES, SatInertiaIDEnv, Scenario
from satid_gym.estimators import (
    AdaptiveEKF,
    FilterpyAdaptiveEKF,
    FilterpyMomentumEKF,
    MomentumEKF,
    MomentumSmoother,
)
from satid_gym.estimators.filterpy.calibration import CalibratedModel
from satid_gym.estimators.momentum import MomentumEKFSettings
from satid_gym.evaluation import fly, seeds
from satid_gym.laws import InertiaLaw
from satid_gym.policies import find
from satid_gym.policies.registry import make_baseline
from satid_gym.policy import missions
from satid_gym.problem import problem
from satid_gym.scenario import prior_of
from satid_gym.tolerances import Tolerances
from satid_gym.vector import SatInertiaIDVectorEnv
from tests.tolerances import ALL

pytestmark = pytest.mark.interpreted

SLOW = pytest.mark.slow  # each state size compiles the kernels again
KINDS = {
    "bias": {"gyro_bias": 1e-4},
    "gain": {"gyro_scale": 1e-3, "gyro_alignment": 3e-3},
    "wheels": {"wheel_inertia": 1e-2, "wheel_alignment": 5e-3},
    "all": ALL,
}


def world(tolerances, **settings):
    return Scenario(tolerances=Tolerances(**tolerances), **settings)


# truth


@pytest.mark.compiled
def test_what_is_drawn_has_the_tolerances():
    env = SatInertiaIDVectorEnv(4000, "microsat", "static", world(ALL))
    env.reset(seed=0)
    plants, wheels = env.fleet.rows.plants, SATELLITES["microsat"].wheels
    off = plants["gyro_gain"] - np.eye(3)
    across = plants["axes"][:, ~np.eye(3, dtype=bool)]  # the nominal axes are the body's
    drawn = {
        "gyro_bias": plants["gyro_bias"],
        "gyro_scale": np.diagonal(off, axis1=1, axis2=2),
        "gyro_alignment": off[:, ~np.eye(3, dtype=bool)],
        "wheel_inertia": plants["wheel_inertia"] / wheels.inertia - 1.0,
        "wheel_alignment": across,
    }
    for name, values in drawn.items():
        count = values.size
        assert abs(values.mean()) < 4.0 * ALL[name] / np.sqrt(count), name
        assert values.std() == pytest.approx(ALL[name], rel=4.0 / np.sqrt(2.0 * count)), name
    np.testing.assert_allclose(np.linalg.norm(plants["axes"], axis=1), 1.0, rtol=1e-14)
    env.close()


def test_a_tolerance_of_zero_draws_nothing():
    """The episode is the same, whatever kinds of errors are drawn after it; without any, to the bit."""
    plain, exact = (SatInertiaIDEnv("microsat", scenario=s) for s in (Scenario(), world({})))
    assert plain.reset(seed=3)[0].tobytes() == exact.reset(seed=3)[0].tobytes()
    assert plain.fleet.rows.plants.tobytes() == exact.fleet.rows.plants.tobytes()
    uncertain = SatInertiaIDEnv("microsat", scenario=world(ALL))
    uncertain.reset(seed=3)
    for name in ("inertia", "attitude", "torque_constant"):
        np.testing.assert_array_equal(uncertain.fleet.rows.plants[name], plain.fleet.rows.plants[name])


def test_the_gyro_reads_what_its_errors_make_of_the_rate():
    quiet = world(ALL, gyro_noise_std=0.0, gyro_bias_walk=0.0, estimator="momentum")
    env = SatInertiaIDEnv("microsat", "static", quiet)
    env.reset(seed=1)
    for _ in range(5):
        env.step(np.array([0.5, -0.2, 0.3], np.float32))
        plant = env.fleet.rows.plants[0]
        expected = plant["gyro_gain"] @ plant["rate"] + plant["gyro_bias"]
        np.testing.assert_allclose(plant["gyro"], expected, rtol=1e-13)
        assert np.abs(plant["gyro"] - plant["rate"]).max() > 1e-5


def test_momentum_is_that_of_the_wheels_as_built():
    env = SatInertiaIDEnv("microsat", "static", world(ALL, disturbance_scale=0.0, gravity_gradient=False))
    env.reset(seed=2)
    sizes = []
    for i in range(20):
        env.step(np.array([0.2, -0.15, 0.1], np.float32) * (-1.0 if i // 5 % 2 else 1.0))
        plant = env.fleet.rows.plants[0]
        spin = plant["axes"] @ (plant["wheel_inertia"] * plant["wheel_speed"])
        total = plant["inertia"] @ plant["rate"] + spin
        np.testing.assert_allclose(total, plant["momentum"], rtol=1e-11, atol=1e-13)
        sizes.append(np.linalg.norm(plant["momentum"]))
    assert np.ptp(sizes) < 1e-5 * np.mean(sizes)  # sunlight alone is left


# belief


def readings(tolerances, inertia, seed, **settings):
    """Of a satellite with these errors, flown by a filter that takes sensors and wheels as nominal."""
    recording = record(
        make_baseline("rate_square", "microsat"),
        satellite="microsat",
        inertia=inertia,
        seeds=[seed],
        scenario=world(tolerances, horizon=60.0, **settings),
        estimator={"name": "momentum", "calibrate": False},
    )
    return recording.gyro[0], recording.tachometer[0], recording.dt


@pytest.fixture(scope="module")
def flown():
    """Readings of a satellite with all errors and products of inertia."""
    return readings(ALL, "drift", 90_001, tilt_std=0.1)


@pytest.mark.parametrize(
    ("kind", "parameters"),
    [
        ("all", "full"),
        ("all", "principal"),
        ("bias", "full"),
        ("gain", "principal"),
        ("wheels", "principal"),
    ],
)
def test_compiled_equals_filterpy(flown, kind, parameters):
    gyro, tachometer, dt = flown
    prior = prior_of(SATELLITES["microsat"], world(KINDS[kind]))
    compiled = MomentumEKF(parameters=parameters).run(prior, gyro, tachometer, dt)
    plain = FilterpyMomentumEKF(parameters=parameters)
    plain.reset(prior, gyro[0], tachometer[0])
    std = np.sqrt(np.diag(plain.covariance))
    np.testing.assert_allclose(compiled.mean[0], plain.mean, rtol=1e-12)
    np.testing.assert_allclose(compiled.covariance[0], plain.covariance, rtol=1e-9, atol=1e-24)
    for i in range(1, 300):
        plain.predict(tachometer[i], dt)
        nis = plain.update(gyro[i], tachometer[i])
        std = np.sqrt(np.maximum(np.diag(plain.covariance), 1e-300))
        assert np.abs(compiled.mean[i] - plain.mean).max() <= 1e-9 * np.abs(plain.mean).max()
        assert np.all(np.abs(compiled.mean[i] - plain.mean) <= 1e-7 * std), i
        assert np.all(np.abs(compiled.covariance[i] - plain.covariance) <= 1e-8 * np.outer(std, std)), i
        assert compiled.nis[i] == pytest.approx(nis, rel=1e-7)


def assert_equals_filterpy(compiled: AdaptiveEKF, plain: FilterpyAdaptiveEKF, kind: str, law, seed: int) -> None:
    """Means of the two filters at each reading of a flight."""
    gyro, tachometer, dt = readings(KINDS[kind], law, seed)
    prior = prior_of(SATELLITES["microsat"], world(KINDS[kind]))
    run = compiled.run(prior, gyro, tachometer, dt)
    plain.reset(prior, gyro[0], tachometer[0])
    for i in range(1, len(gyro)):
        plain.predict(tachometer[i], dt)
        plain.update(gyro[i], tachometer[i])
        std = np.sqrt(np.maximum(np.diag(plain.covariance), 1e-300))
        assert np.all(np.abs(run.mean[i] - plain.mean) <= 1e-6 * std), i


def test_adaptive_equals_filterpy_with_errors_of_the_scale():
    assert_equals_filterpy(AdaptiveEKF(), FilterpyAdaptiveEKF(), "gain", "periodic", 90_003)


@pytest.mark.parametrize("settings", [{"calibrate": False, "rate_coordinates": True}, {}])
def test_adaptive_equals_filterpy(settings):
    """With a step of the inertia, after which M is what is known, and the rate no longer."""
    compiled, plain = AdaptiveEKF(**settings), FilterpyAdaptiveEKF(**settings)
    assert_equals_filterpy(compiled, plain, "bias", InertiaLaw("step", size=0.2, time=40.0), 90_002)
    assert compiled.steps == plain.steps == 1


def test_derivatives_are_those_of_finite_differences():
    prior = prior_of(SATELLITES["microsat"], world(ALL))
    model = CalibratedModel(MomentumEKFSettings(parameters="full"), prior)
    generator = np.random.default_rng(0)
    x, covariance = model.start(np.array([0.01, -0.02, 0.015]), np.array([50.0, -80.0, 120.0]))
    x = x + np.sqrt(np.diag(covariance)) * generator.normal(size=model.size)
    w0, w1 = np.array([50.0, -80.0, 120.0]), np.array([55.0, -70.0, 110.0])
    scale = np.sqrt(np.diag(covariance)) + 1e-9
    for function, jacobian in (
        (lambda v: model.reading(v, w1), model.measurement_jacobian(x, w1, model.reading(x, w1))),
        (lambda v: model.step(v, w0, w1, 0.1), model.step_jacobian(x, w0, w1, 0.1)),
    ):
        for j in range(model.size):
            h = np.zeros(model.size)
            h[j] = 1e-4 * scale[j]
            slope = (function(x + h) - function(x - h)) / (2.0 * h[j])
            np.testing.assert_allclose(jacobian[:, j] * scale[j], slope * scale[j], rtol=1e-6, atol=1e-10)


@pytest.mark.compiled
@pytest.mark.parametrize("estimator", [pytest.param("momentum", marks=SLOW), "adaptive"])
@pytest.mark.parametrize("kind", KINDS)
def test_it_is_consistent_where_the_data_sheet_tells_of_the_error(kind, estimator):
    """Mean NEES of 40 episodes; without calibration the same flights are far outside of it.

    The filter has states for errors of all kinds; with those of one kind alone it is compared with filterpy above.
    """
    scores = fly(
        make_baseline("rate_square", "microsat"),
        satellite="microsat",
        inertia="static",
        seeds=seeds("validation", 40),
        scenario=world({**dict.fromkeys(ALL, 1e-6), **KINDS[kind]}),
        estimator=estimator,
    ).scores()
    assert 0.3 < scores["nees"].mean() < 1.6


@pytest.mark.compiled
def test_without_calibration_it_is_far_off():
    scores = fly(
        make_baseline("rate_square", "microsat"),
        satellite="microsat",
        inertia="static",
        seeds=seeds("validation", 20),
        scenario=world(ALL),
        estimator={"name": "adaptive", "calibrate": False},
    ).scores()
    assert scores["nees"].mean() > 5.0


def test_a_common_error_of_the_rotors_stays_in_the_covariance():
    """Rotors heavier by one factor give the same readings for a body heavier by it: no excitation finds it."""
    told = world({**dict.fromkeys(ALL, 1e-6), "wheel_inertia": 0.01})
    env = SatInertiaIDEnv("microsat", "static", told)
    env.reset(seed=0)
    policy = make_baseline("rate_square", "microsat")
    (mission,) = missions(problem("microsat", "static", told))
    policy.reset(mission, [0])
    observation, _ = env.reset(seed=0)
    for _ in range(300):
        observation, *_ = env.step(policy(observation[None])[0])
    estimate = np.diagonal(env.fleet.rows.reports[0]["inertia_estimate"])
    std = 10.0 ** (observation[env.layout["uncertainty"]] - 2.0) * np.diagonal(mission.prior.inertia) / estimate
    common = 0.01 / np.sqrt(3.0)
    assert np.all((0.99 * common < std) & (std < 1.1 * common))


def test_the_rate_that_policies_see_is_corrected():
    told = world({**dict.fromkeys(ALL, 1e-6), "gyro_bias": 5e-3}, disturbance_scale=0.0)
    env = SatInertiaIDEnv("microsat", "static", told)
    env.reset(seed=4)
    for i in range(120):
        observation, *_ = env.step(np.full(3, 0.3 if i // 5 % 2 else -0.3, np.float32))
    seen = observation[env.layout["rate"]] * SATELLITES["microsat"].rate_limit
    plant = env.fleet.rows.plants[0]
    assert np.abs(plant["gyro"] - plant["rate"]).max() > 2e-3
    assert np.abs(seen - plant["rate"]).max() < 1e-3


def nees(policy, estimator, **settings):
    """Mean NEES of 30 episodes of a microsat whose inertia stays."""
    cell = {"satellite": "microsat", "inertia": "static", "seeds": seeds("validation", 30)}
    return (
        fly(make_baseline(policy, "microsat"), scenario=settings, estimator=estimator, **cell).scores()["nees"].mean()
    )


@pytest.mark.compiled
@pytest.mark.parametrize(
    ("policy", "settings", "most"),
    [
        ("sine", {"torque_noise": 0.0}, 1.5),
        ("sine", {"torque_noise": 0.0, "gyro_noise_std": 2e-4}, 1.5),
        ("multi_step", {"gyro_noise_std": 1e-3}, 1.5),
        ("zero", {"gyro_noise_std": 1e-3}, 2.0),
        ("zero", {"torque_noise": 0.0}, 1.0),
    ],
)
def test_rate_coordinates_stay_consistent_with_little_excitation(policy, settings, most):
    """Where errors of the momentum do not: there the estimates are pulled down and then believed."""
    assert nees(policy, {"name": "adaptive", "rate_coordinates": True}, **settings) < most
    assert nees(policy, {"name": "adaptive", "rate_coordinates": False}, **settings) > 4.0


@pytest.mark.compiled
def test_a_varying_inertia_that_pulls_no_scale_leaves_the_filter_consistent():
    """In errors of the rate NEES is 2."""
    cell = {"satellite": "smallsat", "inertia": "periodic", "scenario": "calibration"}
    assert fly(find("rigid_tour"), control="rate", seeds=seeds("validation", 24), **cell).scores()["nees"].mean() < 1.3


@pytest.mark.compiled
def test_planners_take_sensors_and_wheels_as_nominal():
    flown = fly(
        make_baseline("mpc", "microsat"),
        satellite="microsat",
        inertia="static",
        seeds=seeds("validation", 4),
        scenario=world(ALL, horizon=60.0),
    ).scores()
    assert flown["final_error"].mean() < 0.005


# what is refused


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"gyro_bias": -1e-4}, "gyro_bias must be"),
        ({"wheel_inertia": 0.2}, r"wheel_inertia must be .* 0\.1"),
        ({"gyro_scale": "0.1"}, "gyro_scale must be a"),
        ({"gyro_scalee": 0.1}, "unknown .*gyro_scale"),
    ],
)
def test_tolerances_that_cannot_be_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        Tolerances.from_dict(settings)


def test_satellites_with_errors_of_different_kinds_need_one_choice():
    one = SATELLITES["microsat"].replace(tolerances=Tolerances(gyro_bias=1e-4))
    with pytest.raises(ValueError, match=r"tolerances of the same kinds.*give scenario tolerances"):
        problem([one, "cubesat"])
    assert problem([one, "cubesat"], scenario={"tolerances": {"gyro_bias": 1e-4}})


def test_the_smoother_refuses_what_it_does_not_smooth(flown):
    gyro, tachometer, dt = flown
    prior = prior_of(SATELLITES["microsat"], world(ALL))
    with pytest.raises(ValueError, match=r"smooths no errors of sensors and wheels: .*calibrate=False"):
        MomentumSmoother(parameters="full").run(prior, gyro, tachometer, dt)


# the study


@pytest.mark.compiled
def test_the_study_of_consistency_writes_what_it_flew(tmp_path, capsys):
    study = ConsistencyStudy(
        worlds=("all small errors",),
        policies=("zero",),
        satellites=("cubesat",),
        inertias=("static",),
        episodes=3,
        output=tmp_path / "consistency.json",
    )
    assert consistency_main(study) == 0
    (cell,) = json.loads((tmp_path / "consistency.json").read_text())["cells"]
    scores = fly(
        make_baseline("zero", "cubesat"),
        satellite="cubesat",
        inertia="static",
        seeds=seeds("validation", 3),
        scenario=WORLDS["all small errors"].scenario,
    ).scores()
    assert cell["nees"] == pytest.approx(scores["nees"].mean(), rel=1e-12)
    assert cell["final_error"] == pytest.approx(scores["final_error"].mean(), rel=1e-12)
    assert f"{cell['nees']:.2f}" in capsys.readouterr().out


def test_the_study_refuses_a_world_that_it_does_not_know():
    with pytest.raises(ValueError, match="unknown world 'gyro'"):
        ConsistencyStudy(worlds=("gyro",)).check()
