"""Settings: what they refuse and how they say it, and their way to JSON and back."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from satid_gym import (
    SATELLITES,
    SCENARIOS,
    Disturbance,
    InertiaLaw,
    LawRanges,
    ReactionWheels,
    RewardSettings,
    Satellite,
    SatInertiaIDEnv,
    SatInertiaIDVectorEnv,
    Scenario,
)
from satid_gym.estimators import (
    MomentumEKF,
    MomentumEKFSettings,
    RateEKF,
    RateEKFSettings,
    estimator_settings,
)
from satid_gym.estimators.inertia import inertia_parameters
from satid_gym.problem import Problem, problem
from satid_gym.satellite import BENCHMARK_SATELLITES
from satid_gym.scenario import prior_of
from tests.cases import case

WHEELS = ReactionWheels(inertia=2e-3, max_torque=0.1, max_speed=900.0)
MOMENTS = (6.5, 6.0, 4.5)


def wheels(**changes) -> ReactionWheels:
    return ReactionWheels(**({"inertia": 2e-3, "max_torque": 0.1, "max_speed": 900.0} | changes))


def satellite(inertia=MOMENTS, **changes) -> Satellite:
    return Satellite("test", inertia, changes.pop("wheels", WHEELS), **changes)


# Each refusal names the culprit, its value where that is short, and what would do.

REFUSED = {
    # tensors
    "asymmetric": (lambda: satellite([[6, 1, 0], [0, 6, 0], [0, 0, 6]]), "inertia of test must be symmetric"),
    "indefinite": (lambda: satellite((6.0, 6.0, -1.0)), "must be positive definite; its principal moments are"),
    "indefinite off the diagonal": (
        lambda: satellite([[6, 7, 0], [7, 6, 0], [0, 0, 6]]),
        "must be positive definite; its principal moments are",
    ),
    "singular": (lambda: satellite((6.0, 6.0, 0.0)), "must be positive definite"),
    "triangle": (lambda: satellite((1.0, 2.0, 3.5)), r"triangle inequality of principal moments: 1 \+ 2 < 3\.5"),
    "tensor shape": (lambda: satellite((1.0, 1.0)), re.escape("must have shape (3,) or (3, 3), got (2,)")),
    "tensor nan": (lambda: satellite((1.0, np.nan, 1.0)), "inertia of test must be finite"),
    "tensor text": (lambda: satellite("heavy"), "inertia of test must be numeric, got 'heavy'"),
    "less than its wheels": (lambda: satellite((1e-3, 1e-3, 1e-3)), "must exceed its rotors' inertia"),
    # wheels
    "two wheels": (lambda: wheels(axes=np.eye(3)[:, :2]), re.escape("shape (3, n) with n >= 3, got (3, 2)")),
    "rows for columns": (lambda: wheels(axes=np.eye(4, 3)), re.escape("shape (3, n) with n >= 3, got (4, 3)")),
    "long axis": (lambda: wheels(axes=2.0 * np.eye(3)), "unit columns; their lengths are .*: divide by them"),
    "axes in a plane": (
        lambda: wheels(axes=np.array([[1, 0, 0.6], [0, 1, 0.8], [0, 0, 0]])),
        "must span space; these lie in a plane",
    ),
    "wheel inertia": (lambda: wheels(inertia=0.0), "wheel inertia must be positive, got 0.0"),
    "wheel torque": (lambda: wheels(max_torque=[0.1, -0.1, 0.1]), "wheel max_torque must be positive"),
    "wheel speed": (lambda: wheels(max_speed=[1.0, 2.0]), re.escape("must have shape () or (3,), got (2,)")),
    # satellites
    "name": (lambda: Satellite("", MOMENTS, WHEELS), "name must be a non-empty string, got ''"),
    "no wheels": (lambda: satellite(wheels=3), "wheels must be ReactionWheels or a mapping of its settings, got 3"),
    "mass": (lambda: satellite(mass=-1.0), "mass must be finite and more than 0, got -1.0"),
    "size": (lambda: satellite(size=(1.0, 0.0, 1.0)), "size must be positive"),
    "rate limit": (lambda: satellite(rate_limit=0.0), "rate_limit must be finite and more than 0"),
    "gyro noise": (lambda: satellite(gyro_noise_std=-1e-5), "gyro_noise_std must be finite and at least 0, got -1e-05"),
    "tachometer noise": (lambda: satellite(tachometer_noise_std=np.nan), "tachometer_noise_std must be finite"),
    "disturbance": (lambda: satellite(disturbance_std=True), "disturbance_std must be a number, got True"),
    "misspelt setting": (
        lambda: SATELLITES["cubesat"].replace(gyro_noise=1e-4),
        "unknown setting of Satellite 'gyro_noise'; expected one of .* Did you mean 'gyro_noise_std'?",
    ),
    # laws
    "mode": (lambda: InertiaLaw("stpe"), "unknown mode of InertiaLaw 'stpe'; expected one of .*Did you mean 'step'?"),
    "law size": (lambda: InertiaLaw("step", size=-1.0), "size of the inertia law must be finite and more than -1"),
    "drift in no time": (lambda: InertiaLaw("drift", time=0.0), "time of the inertia law must be finite and more than"),
    "step before the start": (lambda: InertiaLaw("step", time=-1.0), "time of the inertia law must be .* at least 0"),
    "frequency": (lambda: InertiaLaw("periodic", frequency=-0.1), "frequency of the inertia law must be .* at least 0"),
    "phase": (lambda: InertiaLaw("periodic", frequency=0.02, phase=np.inf), "phase of the inertia law must be finite"),
    "change": (lambda: InertiaLaw("step", change=np.tri(3)), "change of the inertia law must be symmetric"),
    "reversed range": (lambda: LawRanges(step_size=(0.2, 0.1)), "step_size of the law ranges must be .low, high."),
    "range beyond": (lambda: LawRanges(step_time=(0.5, 1.5)), "step_time .* <= 1.0, got .0.5, 1.5."),
    "range of three": (lambda: LawRanges(frequency=(1, 2, 3)), r"must have shape \(2,\), got \(3,\)"),
    # scenarios
    "negative noise": (lambda: Scenario(torque_noise=-0.1), "torque_noise must be finite and at least 0, got -0.1"),
    "negative gyro noise": (lambda: Scenario(gyro_noise_std=-1.0), "gyro_noise_std must be finite and at least 0"),
    "negative bias walk": (lambda: Scenario(gyro_bias_walk=-1.0), "gyro_bias_walk must be finite and at least 0"),
    "no prior": (lambda: Scenario(prior_std=0.0), "prior_std must be finite and more than 0, got 0.0"),
    "periods": (lambda: Scenario(sample_period=0.3), "decision_period / sample_period must be an integer"),
    "horizon": (lambda: Scenario(horizon=0.5), "horizon / decision_period must be an integer, got 0.5"),
    "wheel speeds": (lambda: Scenario(wheel_speed_range=1.5), "must be finite and at least 0 and at most 1, got 1.5"),
    "termination": (lambda: Scenario(termination_factor=0.5), "termination_factor must be finite and at least 1"),
    "prior scale": (lambda: Scenario(prior_scale={"cubesat": -1.0}), "prior_scale of cubesat must be finite and more"),
    "number as text": (lambda: Scenario(horizon="300"), "horizon must be a number, got '300'"),
    "scenario's laws": (
        lambda: Scenario(laws={"steps": (0, 1)}),
        "Did you mean 'step_size'?|Did you mean 'step_time'?",
    ),
    # disturbance
    "torque": (lambda: Disturbance(constant=(1.0, 2.0)), r"disturbance constant must have shape \(3,\), got \(2,\)"),
    "orbit": (lambda: Disturbance(orbit_rate=-1e-3), "orbit_rate must be finite and at least 0"),
    # reward
    "criterion": (
        lambda: RewardSettings(criterion="logdte"),
        "unknown criterion of RewardSettings 'logdte'.*mean 'logdet'?",
    ),
    "reward's type": (lambda: problem(reward=3), "reward must be the name of a criterion, a mapping or Reward.*got 3"),
    "net": (lambda: RewardSettings(net="yes"), "net must be True or False, got 'yes'"),
    "gain": (lambda: RewardSettings(gain_scale=-0.1), "gain_scale must be finite and at least 0, got -0.1"),
    "weight": (lambda: RewardSettings(envelope_weight=np.inf), "envelope_weight must be finite"),
    # estimators
    "estimator": (lambda: estimator_settings("momentun"), "unknown estimator 'momentun'.*Did you mean 'momentum'?"),
    "estimator's type": (lambda: problem(estimator=3), "estimator must be a name, a mapping or its settings.*got 3"),
    "estimator in a vector": (
        lambda: SatInertiaIDVectorEnv(2, estimator=MomentumEKF()),
        "in the single environment an object that follows Estimator",
    ),
    "parameters": (
        lambda: MomentumEKF(parameters="ful"),
        "unknown parameters of MomentumEKFSettings 'ful'.*mean 'full'?",
    ),
    "walk": (lambda: MomentumEKF(inertia_walk=-1.0), "inertia_walk must be finite and at least 0, got -1.0"),
    "substeps": (lambda: MomentumEKF(substeps=0), "substeps must be an integer of at least 1, got 0"),
    "rate noise": (lambda: RateEKF(gyro_std=0.0), "gyro_std must be finite and more than 0, got 0.0"),
    "another filter's setting": (lambda: RateEKF(disturbance_walk=0.1), "unknown setting of RateEKFSettings"),
    # problem
    "covariance": (lambda: problem(include_covariance=1), "include_covariance must be True or False, got 1"),
    "satellite": (lambda: problem("micosat"), "unknown satellite 'micosat'; expected one of .*mean 'microsat'?"),
    "satellite's type": (
        lambda: problem(3),
        "satellite must be a name, a file, module:name, a Satellite, a mapping or a list of these",
    ),
    "no satellite": (lambda: problem([]), "satellite must be a name"),
    "inertia": (lambda: problem(inertia="peroidic"), "unknown inertia mode 'peroidic'.*mean 'periodic'?"),
    "scenario": (lambda: problem(scenario="papre"), "unknown scenario 'papre'.*Did you mean 'paper'?"),
    "scenario's name": (
        lambda: problem(scenario={"name": "flexx", "horizon": 60.0}),
        "scenario 'flexx' is named almost like 'flex': say which one its settings change, by base=\"flex\"",
    ),
    "scenario's setting": (
        lambda: problem(scenario={"horizn": 1.0}),
        "unknown setting of Scenario 'horizn'.*'horizon'",
    ),
    "reward's setting": (lambda: problem(reward={"gain": 1.0}), "unknown setting of RewardSettings 'gain'"),
    "no steps": (lambda: problem(max_episode_steps=0), "max_episode_steps must be an integer of at least 1, got 0"),
    "two horizons": (
        lambda: problem(max_episode_steps=5, scenario={"horizon": 60.0}),
        "max_episode_steps=5 makes a horizon of 5 s, and the scenario's settings say 60 s: give one of the two",
    ),
    "half a step": (lambda: problem(max_episode_steps=1.5), "max_episode_steps must be an integer"),
    "environment's satellite": (lambda: SatInertiaIDEnv("cubsat"), "Did you mean 'cubesat'?"),
    "vector's satellite": (lambda: SatInertiaIDVectorEnv(2, "cubsat"), "Did you mean 'cubesat'?"),
    "no environment": (lambda: SatInertiaIDVectorEnv(0), "num_envs must be an integer of at least 1, got 0"),
    "no thread": (
        lambda: SatInertiaIDVectorEnv(2, num_threads=0),
        "num_threads must be an integer of at least 1, got 0",
    ),
    "render": (lambda: SatInertiaIDEnv(render_mode="humn"), "unknown render mode 'humn'"),
    "vector's render": (lambda: SatInertiaIDVectorEnv(1, render_mode="human"), "unknown render mode"),
}


def test_refusal_says_what_is_wrong_and_what_is_valid():
    for name, (build, message) in REFUSED.items():
        with case(name), pytest.raises(ValueError, match=message):
            build()


def test_autoreset_mode_is_one_of_gymnasiums():
    with pytest.raises(ValueError, match="sometimes"):
        SatInertiaIDVectorEnv(2, autoreset_mode="sometimes")
    for mode in AutoresetMode:
        for spelling in (mode, mode.name, mode.value):
            assert SatInertiaIDVectorEnv(2, autoreset_mode=spelling).autoreset_mode is mode


def test_satellites_of_one_environment_need_as_many_wheels(pyramid):
    with pytest.raises(ValueError, match=r"same number of wheels, got \[3, 4\]"):
        problem(["microsat", pyramid])


def test_unknown_name_without_a_near_one_gives_no_hint():
    with pytest.raises(ValueError, match=r"unknown satellite 'qqq'; expected one of \[.*\]\. Or the path of"):
        problem("qqq")


def test_a_flat_plate_is_physical():
    """1 + 1 = 2: the triangle inequality met with equality."""
    assert satellite((1.0, 1.0, 2.0)).inertia[2, 2] == 2.0


# What they hold


def test_paper_satellites():
    """Table II of the paper, and the design's wheels."""
    table = {
        "cubesat": (24.0, (0.2, 0.2, 0.3), (0.26, 0.26, 0.16), 0.01, 460.0, 1e-4, 0.05, 1e-4, 1e-5),
        "microsat": (95.0, (0.5, 0.6, 0.8), (6.53, 5.96, 4.53), 0.1, 900.0, 2e-3, 0.03, 5e-5, 5e-5),
        "smallsat": (118.0, (0.7, 0.8, 1.0), (10.6, 14.2, 15.3), 0.1, 1500.0, 3e-3, 0.02, 2e-5, 1e-4),
    }
    assert sorted(BENCHMARK_SATELLITES) == sorted(table)
    for name, (mass, size, inertia, torque, speed, j, rate, gyro, disturbance) in table.items():
        s = SATELLITES[name]
        assert (s.mass, tuple(s.size), tuple(np.diag(s.inertia))) == (mass, size, inertia)
        assert set(s.wheels.max_torque) == {torque}
        assert set(s.wheels.max_speed) == {speed}
        assert set(s.wheels.inertia) == {j}
        np.testing.assert_array_equal(s.wheels.axes, np.eye(3))
        assert (s.rate_limit, s.gyro_noise_std, s.disturbance_std, s.tachometer_noise_std) == (
            rate,
            gyro,
            disturbance,
            0.05,
        )


def test_innocube_has_what_its_telemetry_gave():
    """J over rotor inertia of docs/identify.md; the wheels' momentum is 30 mN m s."""
    s = SATELLITES["innocube"]
    table = Path("docs/identify.md").read_text(encoding="utf-8")
    (row,) = re.findall(r"^\| inertia over rotor inertia \|(.*)\|$", table, flags=re.M)
    over = inertia_parameters(s.inertia, "full") / s.wheels.inertia[0]
    np.testing.assert_allclose(over, [float(cell) for cell in row.split("|")])
    np.testing.assert_allclose(s.wheels.inertia * s.wheels.max_speed, 0.030, rtol=0.01)


def test_scenarios():
    names = "calibration default faults flex operations paper slosh tight wheels4"
    assert " ".join(sorted(SCENARIOS)) == names
    default, tight, paper = SCENARIOS["default"], SCENARIOS["tight"], SCENARIOS["paper"]
    assert (default.decisions, default.samples, paper.samples) == (300, 10, 1)
    microsat = SATELLITES["microsat"]
    np.testing.assert_allclose(tight.operate(microsat).wheels.max_speed, 90.0)
    np.testing.assert_allclose(tight.operate(microsat).wheels.max_torque, 0.1)
    # the paper starts its filter at 0.80 of the CubeSat's true inertia and 0.85 of the others'
    assert prior_of(SATELLITES["cubesat"], paper).inertia[0, 0] == pytest.approx(0.80 * 0.26)
    assert prior_of(microsat, paper).inertia[0, 0] == pytest.approx(0.85 * 6.53)
    assert problem(scenario="paper").estimator == RateEKFSettings(parameters="principal")
    default = MomentumEKFSettings(adaptive=True, parameters="principal")
    assert problem().estimator == problem(scenario="tight").estimator == default
    assert problem(scenario="faults").estimator == default.replace(gate=1e-6)
    assert [name for name in SCENARIOS if SCENARIOS[name].faults.possible] == ["faults"]
    assert [name for name in SCENARIOS if SCENARIOS[name].appendages is not None] == ["flex", "slosh"]
    assert [name for name in SCENARIOS if SCENARIOS[name].wheels is not None] == ["wheels4"]


def test_arrays_of_settings_cannot_be_changed():
    s = SATELLITES["microsat"]
    for array in (s.inertia, s.wheels.axes, s.wheels.inertia, s.wheels.max_speed):
        with pytest.raises(ValueError, match="read-only"):
            array.flat[0] = 1.0


def test_settings_do_not_share_memory_with_what_they_were_built_from():
    inertia = np.diag(MOMENTS)
    s = satellite(inertia)
    inertia[0, 0] = -1.0
    assert s.inertia[0, 0] == 6.5


# JSON


def test_settings_to_json_and_back():
    for value in (
        SATELLITES["smallsat"],
        InertiaLaw("step", time=20.0, change=(0.5, 0.4, 0.3)),
        LawRanges(step_size=(0.0, 0.3)),
        Disturbance(constant=(1e-5, 0.0, 2e-5), gravity_gradient=True),
        RewardSettings(criterion="trace", net=True),
        MomentumEKFSettings(parameters="full", inertia_walk=0.0),
        RateEKFSettings(gyro_std=1e-4),
        *SCENARIOS.values(),
    ):
        with case(value):
            text = json.dumps(value.to_dict(), allow_nan=False)
            back = type(value).from_dict(json.loads(text))
            assert back == value
            assert hash(back) == hash(value)
            assert back.to_dict() == value.to_dict()


def test_problem_rebuilt_from_its_json_is_the_same(pyramid):
    given = problem(
        ["cubesat", SATELLITES["smallsat"].to_dict()],
        InertiaLaw("drift", size=0.1, time=100.0),
        {"name": "tight", "horizon": 50.0, "laws": {"step_size": [0.1, 0.2]}},
        {"name": "momentum", "parameters": "full"},
        "maxeig",
    )
    values = json.loads(json.dumps(given.to_dict(), allow_nan=False))
    back = problem(values["satellites"], values["inertia"], values["scenario"], values["estimator"], values["reward"])
    assert back == given
    assert isinstance(back, Problem)
    assert back.scenario.wheel_speed_scale == 0.1
    assert problem(json.loads(json.dumps(pyramid.to_dict()))).satellites[0] == pyramid


def test_different_settings_are_not_equal():
    assert RewardSettings() != RewardSettings(net=True)
    assert RewardSettings() != MomentumEKFSettings()
    assert SATELLITES["microsat"] != SATELLITES["microsat"].replace(mass=96.0)
