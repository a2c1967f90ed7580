"""Friction of the wheels: closed forms, the textbook's equations, conservation, limits, and the band to avoid."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from satid_gym import ReactionWheels, SatInertiaIDEnv, SatInertiaIDVectorEnv, simulate
from satid_gym.friction import WheelFriction
from satid_gym.satellite import Satellite
from tests.cases import cases

STICKY = WheelFriction(coulomb=4e-3, static=6e-3, viscous=1.6e-5, stribeck_speed=6.0)


def with_friction(satellite: Satellite, friction: WheelFriction) -> Satellite:
    return satellite.replace(wheels=satellite.wheels.replace(friction=friction))


def torque_of(friction: WheelFriction, speed: np.ndarray) -> np.ndarray:
    """f(Omega) as Simscape's manual has it, with breakaway speed and its two derived speeds."""
    stribeck, coulomb = np.sqrt(2.0) * friction.stribeck_speed, friction.stribeck_speed / 10.0
    peak = np.sqrt(2.0 * np.e) * (friction.breakaway - friction.coulomb)
    return (
        peak * np.exp(-((speed / stribeck) ** 2)) * speed / stribeck
        + friction.coulomb * np.tanh(speed / coulomb)
        + friction.viscous * speed
    )


def textbook(satellite, torque, dt, rate, speed):
    """Rates and wheel speeds by Euler's equations with rotors, in omega and Omega, at the end of each interval."""
    a, j, friction = satellite.wheels.axes, satellite.wheels.inertia, satellite.wheels.friction
    body = satellite.inertia - (a * j) @ a.T
    state, out = np.concatenate([rate, speed]), []
    for u in torque:

        def slope(_, x, u=u):
            omega, wheels = x[:3], x[3:]
            net = u - torque_of(friction, wheels)
            turn = np.linalg.solve(body, -np.cross(omega, satellite.inertia @ omega + a @ (j * wheels)) - a @ net)
            return np.concatenate([turn, net / j - a.T @ turn])

        state = solve_ivp(slope, (0.0, dt), state, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
        out.append(state)
    return np.array(out)


def test_what_friction_is_made_of():
    speed = np.array([0.3, 6.0, 200.0])
    found = torque_of(STICKY, speed)
    assert found[1] == pytest.approx(6e-3 + 6.0 * 1.6e-5, rel=1e-7), "stiction at its speed"
    assert found[2] == pytest.approx(4e-3 + 200.0 * 1.6e-5, rel=1e-12), "Coulomb and viscous alone"


def test_a_wheel_spins_down_as_the_closed_form_says(microsat):
    """Two wheels at rest in the body, so the axes stay: j' dOmega/dt = -(c Omega + T_c), j' = j (1 - j / J)."""
    still = microsat.replace(inertia=(6.0, 6.0, 6.0))
    c, coulomb = 1e-4, 3e-3
    flown = with_friction(still, WheelFriction(coulomb=coulomb, viscous=c))
    flight = simulate(flown, np.zeros((40, 3)), 1.0, wheel_speed0=(0.0, 0.0, 700.0))
    rate = c / (2e-3 * (1.0 - 2e-3 / 6.0))
    expected = (700.0 + coulomb / c) * np.exp(-rate * flight.time) - coulomb / c
    assert expected[-1] > 60.0
    np.testing.assert_allclose(flight.wheel_speed[:, 2], expected, rtol=1e-10)
    np.testing.assert_allclose(flight.omega[:, 2], 2e-3 * (700.0 - flight.wheel_speed[:, 2]) / 6.0, rtol=1e-10)


@cases("name", ["microsat", "pyramid"])
@cases("friction", [STICKY, WheelFriction(coulomb=1e-2), WheelFriction(viscous=2e-5), STICKY.replace(static=1.2e-2)])
@pytest.mark.compiled
def test_equals_the_textbook_through_zero(name, friction, request):
    """Wheels that reverse, stick and break away again, under torque that changes every second."""
    satellite = with_friction(request.getfixturevalue(name), friction)
    n = satellite.wheels.count
    torque = 0.03 * np.random.default_rng(2).uniform(-1.0, 1.0, (60, n))
    torque[20:30] *= 0.05  # less than stiction
    rate, speed = np.array([0.01, -0.02, 0.015]), np.resize([12.0, -8.0, 3.0, 0.0], n)
    expected = textbook(satellite, torque, 1.0, rate, speed)
    assert (np.diff(np.sign(expected[:, 3:]), axis=0) != 0).any()
    flight = simulate(satellite, torque, 1.0, omega0=rate, wheel_speed0=speed, substeps=10)
    np.testing.assert_allclose(flight.omega[1:], expected[:, :3], rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(flight.wheel_speed[1:], expected[:, 3:], rtol=0.0, atol=1e-4)


def test_friction_keeps_momentum_and_takes_energy(skewed):
    flown = with_friction(skewed, STICKY)
    flight = simulate(flown, np.zeros((200, 3)), 1.0, omega0=(0.05, -0.08, 0.1), wheel_speed0=(300.0, -40.0, 5.0))
    inertial = Rotation.from_quat(flight.attitude).apply(flight.momentum)
    np.testing.assert_allclose(inertial, np.tile(inertial[0], (201, 1)), rtol=0.0, atol=1e-9)
    a, j = flown.wheels.axes, flown.wheels.inertia
    spin = flight.wheel_speed + flight.omega @ a
    body = np.einsum("ti,ij,tj->t", flight.omega, flown.inertia - (a * j) @ a.T, flight.omega)
    energy = 0.5 * (body + (j * spin**2).sum(axis=1))
    assert np.all(np.diff(energy) < 0.0)
    np.testing.assert_allclose(flight.wheel_speed[-1, 1:], 0.0, atol=0.1)


def test_a_wheel_that_rubs_stays_at_its_limit_only_while_the_motor_holds_it_there(microsat):
    flown = with_friction(microsat, WheelFriction(coulomb=5e-3))
    torque = np.repeat([[0.0, 0.0, 0.05], [0.0, 0.0, 0.006], [0.0, 0.0, 0.004]], 20, axis=0)
    flight = simulate(flown, torque, 1.0, wheel_speed0=(0.0, 0.0, 850.0))
    speed = flight.wheel_speed[:, 2]
    np.testing.assert_allclose(speed[5:41], 900.0, rtol=1e-9)
    np.testing.assert_allclose(np.diff(speed[41:]), -0.001 / 2e-3 / (1.0 - 2e-3 / 4.53), rtol=1e-3)


def test_without_friction_nothing_is_computed_or_drawn(microsat):
    """The same flight to the last bit, whatever the other settings of a friction that is none."""
    none = with_friction(microsat, WheelFriction(stribeck_speed=1.0))
    torque = np.random.default_rng(0).uniform(-0.1, 0.1, (30, 3))
    np.testing.assert_array_equal(simulate(microsat, torque, 1.0).omega, simulate(none, torque, 1.0).omega)
    envs = [SatInertiaIDEnv(microsat, "static", {"friction": f}) for f in (None, STICKY)]
    first = [env.reset(seed=3)[0] for env in envs]
    np.testing.assert_array_equal(*first)
    np.testing.assert_array_equal(*[env.fleet.rows.plants["stream"] for env in envs])


def test_the_share_of_time_in_the_avoided_band_is_counted(microsat):
    wheels = microsat.wheels.replace(avoided_speed=(20.0, 40.0))
    flown = microsat.replace(wheels=wheels)
    env = SatInertiaIDVectorEnv(8, flown, "static", {"wheel_speed_range": 0.05, "sample_period": 1.0})
    env.reset(seed=0)
    seen = []
    for _ in range(20):
        *_, infos = env.step(np.full((8, 3), 0.01, np.float32))
        speed = np.abs(env.state()["plants"]["wheel_speed"])
        seen.append(((speed >= 20.0) & (speed <= 40.0)).any(axis=1))
        np.testing.assert_array_equal(infos["in_avoided_band"], seen[-1])
    assert 0.1 < np.mean(seen) < 0.9
    tenths = SatInertiaIDEnv(flown, "static", {"wheel_speed_range": 0.0})
    tenths.reset(seed=0)
    for _ in range(60):  # 2.5 rad/s a decision: the band begins in the middle of one
        *_, info = tenths.step(np.array([0.05, 0.0, 0.0], np.float32))
        if info["in_avoided_band"] > 0.0:
            break
    assert info["in_avoided_band"] in [k / 10 for k in range(1, 10)]


@cases(
    ("settings", "message"),
    [
        ({"friction": {"coulomb": -1.0}}, "coulomb friction must be finite and at least 0"),
        ({"friction": {"coulomb": 2e-3, "static": 1e-3}}, "static friction must be finite and at least 0.002"),
        ({"friction": {"stribeck_speed": 1e-3}}, "stribeck_speed must be finite and at least 0.01"),
        ({"friction": 0.1}, "friction must be WheelFriction or a mapping of its settings, got 0.1"),
        ({"avoided_speed": (3.0, 1.0)}, r"avoided_speed of the wheels must be .low, high. with 0 <= low <= high"),
    ],
)
def test_what_is_no_friction_is_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        ReactionWheels(inertia=1e-3, max_torque=0.1, max_speed=500.0, **settings)
