"""How an episode is drawn: the same draws written out with matrices, then limits and refusals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from satid_gym import InertiaLaw, LawRanges, Satellite, SatInertiaIDEnv
from satid_gym.core.random import normal, uniform
from satid_gym.gym_api import seed_stream
from satid_gym.laws import INERTIA_MODES
from satid_gym.satellite import inertia_tensor

RANGES = LawRanges(
    step_size=(0.05, 0.15),
    step_time=(0.3, 0.7),
    drift_size=(-0.1, 0.3),
    periodic_size=(0.01, 0.05),
    frequency=(0.01, 0.03),
    phase=(0.5, 2.0),
)
WORLD = {
    "laws": RANGES,
    "inertia_std": 0.15,
    "tilt_std": 0.3,
    "wheel_speed_range": 0.4,
    "initial_rate_std": 0.1,
    "horizon": 200.0,
}


class Draws:
    """The stream of an environment seeded `seed`, after the draw of its template."""

    def __init__(self, seed: int) -> None:
        self.stream = seed_stream(np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed))))
        uniform(self.stream)

    def normals(self, *shape: int) -> np.ndarray:
        return np.array([normal(self.stream) for _ in range(int(np.prod(shape)))]).reshape(shape)

    def between(self, low: float, high: float) -> float:
        return low + (high - low) * uniform(self.stream)


def is_physical(tensor: np.ndarray) -> bool:
    try:
        inertia_tensor(tensor)
    except ValueError:
        return False
    return True


def drawn_inertia(draws: Draws, nominal: np.ndarray, std: float, tilt: float) -> np.ndarray:
    """R S J S R^T, with S^2 lognormal by axis and R of the quaternion (x, y, z, 1) of half the tilt."""
    scale = np.diag(np.exp(0.5 * std * draws.normals(3)))
    body = scale @ nominal @ scale
    if tilt == 0.0:
        return body
    turn = Rotation.from_quat([*(0.5 * tilt * draws.normals(3)), 1.0]).as_matrix()
    return turn @ body @ turn.T


@pytest.mark.parametrize("tilt", [0.0, 0.3])
@pytest.mark.parametrize("mode", [*INERTIA_MODES, "random"])
@pytest.mark.parametrize("seed", [2, 3, 11])
def test_an_episode_draw_by_draw(seed, mode, tilt, pyramid):
    satellite: Satellite = pyramid.replace(disturbance_std=3e-4, rate_limit=0.03)
    env = SatInertiaIDEnv(satellite, mode, WORLD | {"tilt_std": tilt})
    env.reset(seed=seed)
    plant, draws = env.fleet.rows.plants[0], Draws(seed)

    law = min(int(4.0 * uniform(draws.stream)), 3)
    law = INERTIA_MODES.index(mode) if mode != "random" else law
    assert plant["law"] == law
    low, high = [(0.0, 0.0), RANGES.step_size, RANGES.drift_size, RANGES.periodic_size][law]
    size = draws.between(low, high)
    first, last = (60.0, 140.0) if INERTIA_MODES[law] == "step" else (200.0, 200.0)
    assert plant["law_time"] == pytest.approx(draws.between(first, last), rel=1e-12)
    assert plant["law_frequency"] == pytest.approx(draws.between(*RANGES.frequency), rel=1e-12)
    assert plant["law_phase"] == pytest.approx(draws.between(*RANGES.phase), rel=1e-12)
    assert plant["stepped"] == 0

    factors = {"static": [0.0], "step": [0.0, 1.0], "drift": [0.0, 1.0], "periodic": [-1.0, 0.0, 1.0]}
    for _ in range(1000):
        inertia = drawn_inertia(draws, satellite.inertia, 0.15, tilt)
        if all(is_physical(inertia * (1.0 + f * size)) for f in factors[INERTIA_MODES[law]]):
            break
    np.testing.assert_allclose(plant["inertia"], inertia, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(plant["change"], size * inertia, rtol=1e-10, atol=1e-12)

    scatter, std = draws.normals(3, 4), 3e-4 * np.sqrt(0.5)
    np.testing.assert_allclose(plant["torque_constant"], std * scatter[:, 0], rtol=1e-12)
    np.testing.assert_allclose(plant["torque_cosine"], std * scatter[:, 1], rtol=1e-12)
    np.testing.assert_allclose(plant["torque_sine"], std * scatter[:, 2], rtol=1e-12)
    np.testing.assert_allclose(plant["rate"], 0.1 * 0.03 * scatter[:, 3], rtol=1e-9)
    speed = [draws.between(-0.4 * limit, 0.4 * limit) for limit in satellite.wheels.max_speed]
    np.testing.assert_allclose(plant["wheel_speed"], speed, rtol=1e-9)
    attitude = draws.normals(4)
    np.testing.assert_allclose(plant["attitude"], attitude / np.linalg.norm(attitude), rtol=1e-12)

    spin = satellite.wheels.inertia * plant["wheel_speed"]
    momentum = inertia_at_start(plant) @ plant["rate"] + satellite.wheels.axes @ spin
    np.testing.assert_allclose(plant["momentum"], momentum, rtol=1e-12)


def inertia_at_start(plant: np.void) -> np.ndarray:
    f = np.sin(plant["law_phase"]) if plant["law"] == 3 else 0.0
    return plant["inertia"] + f * plant["change"]


def test_an_absolute_change_is_not_scaled(microsat):
    """A deployment of so many kg m^2 is the same for every body drawn, and no body is drawn that it breaks."""
    change = np.array([[0.5, 0.1, 0.0], [0.1, 0.4, -0.2], [0.0, -0.2, 0.3]])
    env = SatInertiaIDEnv(microsat, InertiaLaw("step", time=33.3, change=change), WORLD)
    for seed in range(5):
        env.reset(seed=seed)
        plant = env.fleet.rows.plants[0]
        np.testing.assert_array_equal(plant["change"], change)
        assert is_physical(plant["inertia"] + change)


@pytest.mark.parametrize(
    ("mode", "moments", "change"),
    [
        # the triangle inequality leaves little: J_z <= J_x + J_y, 12.49 kg m^2 for the nominal body
        ("step", (6.53, 5.96, 4.53), (0.0, 0.0, 7.5)),
        ("drift", (6.53, 5.96, 4.53), (0.0, 0.0, 7.5)),
        ("periodic", (6.53, 5.96, 11.0), (0.0, 0.0, 1.2)),
        ("periodic", (6.53, 5.96, 11.0), (0.0, 0.0, -1.2)),
    ],
)
def test_bodies_that_the_law_would_break_are_drawn_again(mode, moments, change, microsat):
    law = InertiaLaw(mode, time=60.0, frequency=0.01, change=change)
    env = SatInertiaIDEnv(microsat.replace(inertia=moments), law, {"inertia_std": 0.3})
    refused, ends = 0, (-1.0, 0.0, 1.0) if mode == "periodic" else (0.0, 1.0)
    for seed in range(10):
        env.reset(seed=seed)
        draws = Draws(seed)
        for _ in range(5):  # law, size, time, frequency, phase
            uniform(draws.stream)
        while True:
            inertia = drawn_inertia(draws, np.diag(moments), 0.3, 0.0)
            if all(is_physical(inertia + f * law.change) for f in ends):
                break
            refused += 1
        np.testing.assert_allclose(env.fleet.rows.plants["inertia"][0], inertia, rtol=1e-10, atol=1e-12)
    assert refused > 2


def test_where_no_body_is_physical_the_draw_ends_with_an_error(microsat):
    """Moments that scatter over ten thousands of decades hardly ever meet the triangle inequality."""
    env = SatInertiaIDEnv(microsat, "static", {"inertia_std": 1e5})
    with pytest.raises(ValueError, match="no physical inertia tensor in 1000 draws"):
        env.reset(seed=0)


def test_a_step_at_time_zero_has_come(microsat):
    env = SatInertiaIDEnv(microsat, InertiaLaw("step", size=0.1, time=0.0), {"inertia_std": 0.0})
    _, info = env.reset(seed=0)
    np.testing.assert_allclose(info["inertia_true"], 1.1 * microsat.inertia)


def test_wheels_start_within_their_limit():
    env = SatInertiaIDEnv("cubesat", scenario={"wheel_speed_range": 1.0})
    speeds = []
    for seed in range(20):
        env.reset(seed=seed)
        speeds.append(env.fleet.rows.plants["wheel_speed"][0] / 460.0)
    assert np.abs(speeds).max() <= 1.0 + 1e-12
    assert np.max(speeds) > 0.8
    assert np.min(speeds) < -0.8


def test_a_world_at_rest_is_drawn_at_rest(microsat):
    """No spread, no random attitude: the nominal satellite, as the template has it."""
    calm = {"inertia_std": 0.0, "wheel_speed_range": 0.0, "initial_rate_std": 0.0, "disturbance_scale": 0.0}
    env = SatInertiaIDEnv(microsat, "static", calm | {"random_attitude": False})
    env.reset(seed=0)
    plant = env.fleet.rows.plants[0]
    np.testing.assert_array_equal(plant["attitude"], [0.0, 0.0, 0.0, 1.0])
    np.testing.assert_allclose(plant["inertia"], microsat.inertia, rtol=1e-14)
    for name in ("rate", "wheel_speed", "momentum", "torque_constant", "torque_cosine", "torque_sine"):
        np.testing.assert_array_equal(plant[name], 0.0)


FAULTS = {
    "time": (0.2, 0.6),
    "gyro_dropout": 0.5,
    "gyro_dropout_silent": 0.5,
    "gyro_dropout_duration": (5.0, 20.0),
    "tachometer_stuck": 0.5,
    "tachometer_stuck_duration": (20.0, 60.0),
    "wheel_loss": 0.5,
    "wheel_loss_size": (0.3, 0.9),
}


@pytest.mark.parametrize(
    "more",
    [
        {"torque_delay": (1, 3), "gyro_bias_std": 2e-5},
        {"torque_delay": (0, 1)},
        {"gyro_bias_std": 1e-5, "gyro_dropout_silent": 0.0},
        {"gyro_dropout": 0.0, "torque_delay": (0, 2)},
    ],
)
@pytest.mark.parametrize("seed", range(6))
def test_faults_draw_by_draw(seed, more, pyramid):
    """After all else of an episode, in the order of `Faults`; what cannot happen draws nothing."""
    faults = FAULTS | more
    scenario = {"inertia_std": 0.0, "horizon": 200.0, "gyro_bias_walk": 0.0, "faults": faults}
    env = SatInertiaIDEnv(pyramid, "static", scenario)
    env.reset(seed=seed)
    plant, draws = env.fleet.rows.plants[0], Draws(seed)
    for _ in range(1 + 4):  # law, its size, time, frequency and phase
        uniform(draws.stream)
    draws.normals(3 + 3 * 4)  # inertia; disturbance and rate
    for _ in range(pyramid.wheels.count):
        uniform(draws.stream)
    draws.normals(4)  # attitude

    def happens(name: str) -> bool:
        return faults[name] > 0.0 and uniform(draws.stream) < faults[name]

    assert plant["faulty"] == 1
    dropout, silent, stuck, stuck_wheel, weak_wheel = [0.0, 0.0], 0, [0.0, 0.0], -1, -1
    if happens("gyro_dropout"):
        start = draws.between(40.0, 120.0)
        dropout = [start, start + draws.between(5.0, 20.0)]
        silent = int(happens("gyro_dropout_silent"))
    if happens("tachometer_stuck"):
        stuck_wheel = int(pyramid.wheels.count * uniform(draws.stream))
        start = draws.between(40.0, 120.0)
        stuck = [start, start + draws.between(20.0, 60.0)]
    if happens("wheel_loss"):
        weak_wheel = int(pyramid.wheels.count * uniform(draws.stream))
        assert plant["wheel_loss_start"] == pytest.approx(draws.between(40.0, 120.0), rel=1e-12)
        assert plant["wheel_loss_left"] == pytest.approx(1.0 - draws.between(0.3, 0.9), rel=1e-12)
    np.testing.assert_allclose(plant["gyro_dropout"], dropout, rtol=1e-12)
    np.testing.assert_allclose(plant["tachometer_stuck"], stuck, rtol=1e-12)
    found = (plant["gyro_dropout_silent"], plant["tachometer_stuck_wheel"], plant["wheel_loss_wheel"])
    assert found == (silent, stuck_wheel, weak_wheel)
    least, most = more.get("torque_delay", (0, 0))
    assert plant["torque_delay"] == (int(draws.between(least, most + 1)) if most > 0 else 0)
    bias = more.get("gyro_bias_std", 0.0)
    np.testing.assert_allclose(plant["gyro_bias"], bias * draws.normals(3) if bias > 0.0 else 0.0, rtol=1e-12)
    reading = draws.normals(3 + pyramid.wheels.count)  # the first thing drawn after
    np.testing.assert_allclose(
        plant["gyro"] - plant["rate"] - plant["gyro_bias"], pyramid.gyro_noise_std * reading[:3], rtol=1e-6
    )
