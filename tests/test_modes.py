"""Modes of panels and slosh masses: how the filter estimates them with the inertia."""

import numpy as np
import pytest

from baselines.studies.recording import record
from satid_gym import SATELLITES, InertiaLaw, Panel, Satellite, Scenario, SloshMass, Tolerances, simulate
from satid_gym.estimators import AdaptiveEKF, FilterpyAdaptiveEKF, FilterpyMomentumEKF, MomentumEKF, MomentumSmoother
from satid_gym.evaluation import fly, seeds
from satid_gym.modes import mode_of
from satid_gym.policies.registry import make_baseline
from satid_gym.scenario import prior_of
from tests.tolerances import ALL

pytestmark = pytest.mark.interpreted

SLOW = pytest.mark.slow  # each state size compiles the kernels again
STDS = {"mass_std": 0.2, "frequency_std": 0.3, "damping_std": 0.3}
PANELS = Panel(
    mass=0.37,
    hinge=[0.0, 0.3, 0.0],
    axis=[0.0, 0.0, 1.0],
    arm=[0.0, 0.6, 0.0],
    inertia=[0.045, 0.0001, 0.045],
    frequency=0.35,
    damping=0.005,
    mirrored=True,
    **STDS,
)
TANK = SloshMass(
    mass=2.8,
    position=[0.2, 0.0, 0.1],
    direction=[0.0, 0.6, 0.8],
    frequency=0.05,
    damping=0.05,
    deflection_std=0.01,
    **STDS,
)


def satellite(*oscillators: Panel | SloshMass, **settings) -> Satellite:
    return SATELLITES["microsat"].replace(oscillators=oscillators, **settings)


def test_share_of_a_mode_is_that_of_textbooks():
    """A point mass on a hinge: coupling^2 is m (distance from the centre of mass)^2 of each, as the lever shrinks."""
    panel = Panel(mass=0.5, hinge=[0, 0.4, 0], axis=[0, 0, 1], arm=[0, 0.6, 0], frequency=1.0, damping=0.0)
    coupling = mode_of(panel, None).coupling
    np.testing.assert_allclose(coupling, [0.0, 0.0, np.sqrt(0.5) * 1.0])
    pair = mode_of(panel.replace(mirrored=True), 50.0)
    np.testing.assert_allclose(pair.coupling, np.sqrt(2.0) * coupling)
    assert pair.frequency == 1.0  # the two do not move the centre of mass
    single = mode_of(panel, 50.0)
    assert single.frequency == pytest.approx(1.0 / np.sqrt(1.0 - 0.5 / 50.0))


@pytest.mark.parametrize("oscillator", [PANELS, PANELS.replace(mirrored=False), TANK], ids=["pair", "panel", "slosh"])
def test_inertia_of_a_deflection_is_that_of_the_moved_parts(oscillator):
    """By finite differences of the truth's own tensor, from M - A h of a body that turns and does not oscillate."""
    body = satellite(oscillator)
    mode, count = mode_of(oscillator, body.mass), oscillator.count
    scale = 1.0 / np.sqrt(count)

    def tensor(q):
        columns = []
        for rate in np.eye(3):
            flown = simulate(
                body, np.zeros((1, 3)), 1e-9, omega0=rate, deflection0=np.full(count, q * scale), substeps=1
            )
            columns.append(flown.momentum[0])
        return np.column_stack(columns)

    h, per_unit = 1e-3, np.sqrt(oscillator.inertance) * oscillator.frequency / mode.frequency
    slope = (tensor(h) - tensor(-h)) / (2.0 * h)
    curvature = (tensor(h) - 2.0 * tensor(0.0) + tensor(-h)) / (2.0 * h * h)
    np.testing.assert_allclose(slope, per_unit * mode.inertia_slope, atol=1e-6)
    np.testing.assert_allclose(curvature, per_unit**2 * mode.inertia_curvature, atol=1e-5)


def flown(body, inertia="drift", **scenario):
    """Readings of a body, flown by a filter that takes it as rigid, and sensors and wheels as nominal."""
    recording = record(
        make_baseline("rate_square", "microsat"),
        satellite=body,
        inertia=inertia,
        seeds=[90_001],
        scenario=Scenario(horizon=60.0, **scenario),
        estimator={"name": "momentum", "flexible": False, "calibrate": False},
    )
    return recording.gyro[0], recording.tachometer[0], recording.dt


@pytest.mark.parametrize(
    ("oscillators", "tolerances", "parameters"),
    [
        ((PANELS,), {}, "principal"),
        ((PANELS, TANK), ALL, "full"),
    ],
    ids=["panels", "panels, slosh and all errors"],
)
def test_compiled_equals_filterpy(oscillators, tolerances, parameters):
    body = satellite(*oscillators, tolerances=Tolerances(**tolerances))
    gyro, tachometer, dt = flown(body)
    prior = prior_of(body, Scenario())
    compiled = MomentumEKF(parameters=parameters).run(prior, gyro, tachometer, dt)
    plain = FilterpyMomentumEKF(parameters=parameters)
    plain.reset(prior, gyro[0], tachometer[0])
    np.testing.assert_allclose(compiled.mean[0], plain.mean, rtol=1e-12)
    np.testing.assert_allclose(compiled.covariance[0], plain.covariance, rtol=1e-9, atol=1e-21)
    for i in range(1, 300 if parameters == "principal" else 120):  # the largest filter takes long in Python
        plain.predict(tachometer[i], dt)
        nis = plain.update(gyro[i], tachometer[i])
        std = np.sqrt(np.maximum(np.diag(plain.covariance), 1e-300))
        assert np.all(np.abs(compiled.mean[i] - plain.mean) <= 1e-6 * std), i
        assert np.all(np.abs(compiled.covariance[i] - plain.covariance) <= 1e-7 * np.outer(std, std)), i
        assert compiled.nis[i] == pytest.approx(nis, rel=1e-6)


def test_adaptive_equals_filterpy():
    """With a step of the inertia, after which M is what is known, and the rate no longer."""
    body = satellite(PANELS)
    gyro, tachometer, dt = flown(body, InertiaLaw("step", size=0.2, time=40.0))
    prior = prior_of(body, Scenario())
    compiled = AdaptiveEKF()
    run, plain = compiled.run(prior, gyro, tachometer, dt), FilterpyAdaptiveEKF()
    plain.reset(prior, gyro[0], tachometer[0])
    for i in range(1, len(gyro)):
        plain.predict(tachometer[i], dt)
        plain.update(gyro[i], tachometer[i])
        std = np.sqrt(np.maximum(np.diag(plain.covariance), 1e-300))
        assert np.all(np.abs(run.mean[i] - plain.mean) <= 1e-5 * std), i
    assert compiled.steps == plain.steps == 1


@pytest.mark.compiled
@pytest.mark.parametrize(
    ("oscillator", "untold"),
    [(PANELS, 100.0), (TANK.replace(mirrored=True), 5.0), pytest.param(TANK, 5.0, marks=SLOW)],
    ids=["panels", "two tanks", "slosh"],
)
def test_it_is_consistent_where_the_data_sheet_tells_of_the_mode(oscillator, untold):
    """Mean NEES of 30 episodes; a filter that takes the body as rigid is far outside of it."""

    def nees(**settings):
        flight = fly(
            make_baseline("rate_square", "microsat"),
            satellite=satellite(oscillator),
            inertia="static",
            seeds=seeds("validation", 30),
            scenario="default",
            estimator={"name": "adaptive", **settings},
        )
        return flight.scores()["nees"].mean()

    assert 0.3 < nees() < 1.6
    assert nees(flexible=False, parameters="full") > untold


def test_the_smoother_refuses_modes():
    body = satellite(PANELS)
    with pytest.raises(ValueError, match=r"smooths no modes: .*flexible=False"):
        MomentumSmoother().run(prior_of(body, Scenario()), np.zeros((3, 3)), np.zeros((3, 3)), 0.1)


def test_the_gate_of_the_reference_refuses_modes():
    body = satellite(PANELS)
    with pytest.raises(ValueError, match="rigid bodies alone"):
        FilterpyMomentumEKF(gate=1e-6).reset(prior_of(body, Scenario()), np.zeros(3), np.zeros(3))
