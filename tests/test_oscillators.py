"""Panels and slosh masses: their motion with the body, their draw, and what is refused; see also test_basilisk."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from scipy.integrate import solve_ivp

from satid_gym import SATELLITES, Panel, Satellite, SatInertiaIDEnv, SatInertiaIDVectorEnv, SloshMass, simulate
from satid_gym.oscillators import oscillators_of
from tests import flexible

TANK, PANELS = flexible.TANK.replace(damping=0.0), flexible.PANELS.replace(damping=0.0)

INTEGRATING = {"gyro_integrates": True}


def satellite(*oscillators: Panel | SloshMass, **settings) -> Satellite:
    return SATELLITES["microsat"].replace(oscillators=oscillators, **settings)


def kinetic_and_spring_energy(body, flown, k):
    """Of a satellite with one slosh mass, from the velocities of its two point-like parts; wheels relative to it."""
    tank, q = body.oscillators[0], flown.deflection[k, 0]
    h = flown.time[1]
    speed = (flown.deflection[k + 1, 0] - flown.deflection[k - 1, 0]) / (2.0 * h)
    omega, rest = flown.omega[k], body.mass - tank.mass
    place, first = tank.position + q * tank.direction, tank.position
    hub_place = -tank.mass * first / rest  # of its centre of mass, the origin being that of all at rest
    hub_inertia = body.inertia - tank.mass * (first @ first * np.eye(3) - np.outer(first, first))
    hub_inertia = hub_inertia - rest * (hub_place @ hub_place * np.eye(3) - np.outer(hub_place, hub_place))
    velocity = np.cross(omega, place) + speed * tank.direction
    hub_velocity = np.cross(omega, hub_place)
    centre = (tank.mass * velocity + rest * hub_velocity) / body.mass
    moving = tank.mass * np.sum((velocity - centre) ** 2) + rest * np.sum((hub_velocity - centre) ** 2)
    spring = tank.mass * (2.0 * np.pi * tank.frequency * q) ** 2
    return 0.5 * (moving + omega @ hub_inertia @ omega + spring)


def test_energy_is_kept_without_damper_and_motor():
    """Wheels at rest relative to the body are driven by it, so a heavy body with light wheels is taken."""
    body = satellite(TANK)
    body = body.replace(wheels=body.wheels.replace(inertia=1e-12))
    flown = simulate(body, np.zeros((3000, 3)), 0.02, omega0=[0.03, -0.02, 0.04], deflection0=[0.1])
    energy = np.array([kinetic_and_spring_energy(body, flown, k) for k in range(1, 3000)])
    assert np.ptp(flown.deflection) > 0.15
    assert np.ptp(energy) < 1e-5 * energy.mean()  # the rate of travel is a difference of two samples
    damped = body.replace(oscillators=[TANK.replace(damping=0.05)])
    flown = simulate(damped, np.zeros((3000, 3)), 0.02, omega0=[0.03, -0.02, 0.04], deflection0=[0.1])
    assert kinetic_and_spring_energy(damped, flown, 2999) < 0.95 * energy[0]


def test_small_motion_about_one_axis_is_that_of_two_coupled_bodies():
    """J theta'' + a q'' = -u, a theta'' + mu q'' + c q' + k q = 0, by scipy, for a pair of panels."""
    body = satellite(PANELS.replace(damping=0.01, hinge=[0.0, 0.3, 0.0]), inertia=[6.5, 6.0, 4.5])
    inertance, rate = PANELS.inertance, 2.0 * np.pi * 0.35
    a = float(np.cross(PANELS.place, PANELS.mass * PANELS.tangent)[2] + PANELS.spin[2])
    rotor = body.wheels.inertia[2]
    mass = np.array([[4.5 - rotor, 2.0 * a], [a, inertance]])
    torque = 1e-4

    def slope(_, y):
        spring = inertance * (rate**2 * y[2] + 2.0 * 0.01 * rate * y[3])
        return [
            y[1],
            *np.linalg.solve(mass, [-torque, -spring])[[0]],
            y[3],
            np.linalg.solve(mass, [-torque, -spring])[1],
        ]

    times = np.linspace(0.0, 10.0, 101)
    expected = solve_ivp(slope, (0.0, 10.0), np.zeros(4), t_eval=times, rtol=1e-11, atol=1e-15)
    flown = simulate(body, np.tile([0.0, 0.0, torque], (100, 1)), 0.1)
    np.testing.assert_allclose(flown.omega[:, 2], expected.y[1], atol=1e-6 * np.abs(expected.y[1]).max())
    np.testing.assert_allclose(flown.deflection[:, 0], expected.y[2], atol=1e-5 * np.abs(expected.y[2]).max())
    np.testing.assert_allclose(flown.deflection[:, 1], flown.deflection[:, 0], rtol=1e-6, atol=1e-12)


def test_momentum_in_inertial_space_is_kept():
    """Motors, a wheel at its limit, a bending boom and a slosh mass are all inside."""
    body = satellite(flexible.BOOM, TANK, wheels=SATELLITES["microsat"].wheels.replace(max_speed=60.0))
    torque = 0.1 * np.sign(np.sin(np.arange(600)[:, None] * 0.05 + np.arange(3)))
    flown = simulate(body, torque, 0.1, omega0=[0.02, 0.0, -0.01])
    assert np.abs(flown.wheel_speed).max() == pytest.approx(60.0, rel=1e-9)
    size = np.linalg.norm(flown.momentum, axis=1)
    np.testing.assert_allclose(size, size[0], rtol=1e-12)


def test_environment_steps_resolve_the_oscillation():
    """Ten hertz of the environment against a hundred times finer steps."""
    env = SatInertiaIDEnv(satellite(PANELS), "static", {"torque_noise": 0.0})
    env.reset(seed=3)
    row, actions = (
        env.fleet.rows.plants[0].copy(),
        np.random.default_rng(0).uniform(-0.5, 0.5, (30, 3)).astype(np.float32),
    )
    body = satellite(PANELS, inertia=row["inertia"])
    fine = simulate(
        body,
        np.repeat(actions.astype(float), 10, axis=0) * body.wheels.max_torque,
        0.1,
        omega0=row["rate"],
        wheel_speed0=row["wheel_speed"],
    )
    for action in actions:
        _, _, terminated, _, info = env.step(action)
        assert not terminated
    plant = env.fleet.rows.plants[0]
    assert np.abs(fine.deflection).max() > 1e-3
    np.testing.assert_allclose(
        plant["oscillators"]["deflection"], fine.deflection[-1], atol=2e-3 * np.abs(fine.deflection).max()
    )
    assert info["deflection"].shape == (2,)
    assert np.all(info["deflection"] >= np.abs(fine.deflection[-1]) * 0.99)


@pytest.mark.interpreted
@pytest.mark.parametrize("world", [{}, {"friction": {"coulomb": 5e-3, "static": 8e-3}}], ids=["panels", "friction"])
def test_a_gyro_that_integrates_leaves_the_motion_as_it_is(world):
    """It asks for the rate in the middle of each step of the integrator, which is no part of the motion."""
    flown = []
    for integrates in (0, 1):  # switched in the record, so that both are the same kernel's
        env = SatInertiaIDEnv(satellite(PANELS, TANK), "static", {"sensors": INTEGRATING, **world})
        env.fleet.templates.records.plants["sampling"]["on"] = integrates
        env.reset(seed=3)
        for i in range(20):
            env.step(np.array([0.5, -0.3, 0.4], np.float32) * (1.0 if i % 6 < 3 else -1.0))
        flown.append(env.fleet.rows.plants[0].copy())
    one, other = flown
    assert np.abs(one["oscillators"]["deflection"]).max() > 1e-3
    for name in ("rate", "wheel_speed", "momentum"):
        np.testing.assert_allclose(one[name], other[name], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(one["oscillators"]["deflection"], other["oscillators"]["deflection"], atol=1e-12)


@pytest.mark.parametrize("law", ["release", "fuel"])
def test_a_law_leaves_a_hub_that_a_body_can_have(law):
    panels = PANELS.replace(mass=1.0, inertia=[0.12, 0.0, 0.12])
    env = SatInertiaIDVectorEnv(200, satellite(panels), law, estimator={"name": "adaptive", "flexible": False})
    env.reset(seed=0)
    plants, at_rest = env.fleet.rows.plants, panels.inertia_at_rest
    left = plants["inertia"] + plants["change"] - at_rest
    assert np.linalg.eigvalsh(0.5 * np.trace(left, axis1=1, axis2=2)[:, None, None] * np.eye(3) - left).min() >= 0.0
    env.close()


@pytest.mark.compiled
def test_what_is_drawn_has_the_tolerances():
    light = PANELS.replace(mass=0.1, inertia=[0.012, 0.0, 0.012])  # no draw is refused for its inertia
    panels = light.replace(mass_std=0.1, frequency_std=0.2, damping=0.01, damping_std=0.3, deflection_std=0.02)
    env = SatInertiaIDVectorEnv(2000, satellite(panels), "static")
    env.reset(seed=0)
    o = env.fleet.rows.plants["oscillators"]
    np.testing.assert_array_equal(o["mass"][:, 0], o["mass"][:, 1])  # a mirrored pair is alike
    inertance = panels.inertance * o["mass"] / panels.mass
    frequency = np.sqrt(o["stiffness"] / inertance) / (2.0 * np.pi)
    damping = o["damping"] / (4.0 * np.pi * frequency * inertance)
    for values, nominal, std in (
        (o["mass"], panels.mass, 0.1),
        (frequency, panels.frequency, 0.2),
        (damping, panels.damping, 0.3),
    ):
        logs = np.log(values[:, 0] / nominal)
        assert abs(logs.mean()) < 4.0 * std / np.sqrt(len(logs))
        assert logs.std() == pytest.approx(std, rel=4.0 / np.sqrt(2.0 * len(logs)))
    assert o["deflection"].std() == pytest.approx(0.02, rel=0.07)
    relative = o["speed"] / (2.0 * np.pi * frequency)
    assert relative.std() == pytest.approx(0.02, rel=0.07)
    env.close()


@pytest.mark.interpreted
def test_single_and_vector_environment_agree():
    body = satellite(PANELS.replace(frequency_std=0.2), TANK, sensors=INTEGRATING)
    one, many = SatInertiaIDEnv(body), SatInertiaIDVectorEnv(2, body)
    first, several = one.reset(seed=7)[0], many.reset(seed=[7, 8])[0]
    np.testing.assert_array_equal(first, several[0])
    for i in range(10):
        action = np.full(3, 0.5 if i % 4 < 2 else -0.5, np.float32)
        first, reward, _, _, info = one.step(action)
        several, rewards, _, _, infos = many.step(np.tile(action, (2, 1)))
        np.testing.assert_array_equal(first, several[0])
        assert reward == rewards[0]
        np.testing.assert_array_equal(info["deflection"], infos["deflection"][0])


def test_checker_passes():
    env = gym.make("SatInertiaID-v0", satellite=satellite(PANELS), max_episode_steps=20)
    check_env(env.unwrapped, skip_render_check=True)


def test_a_data_sheet_survives_json():
    body = satellite(PANELS, TANK)
    assert Satellite.from_dict(body.to_dict()) == body


def _without(oscillator, name):
    """Settings of an oscillator but for one."""
    return {key: value for key, value in oscillator.to_dict().items() if key != name}


REFUSED = {
    "negative mass": (lambda: TANK.replace(mass=-1.0), "oscillator mass must be finite and more than 0"),
    "no direction": (lambda: TANK.replace(direction=[0, 0, 2.0]), "slosh direction must be a unit vector"),
    "damping": (lambda: TANK.replace(damping=0.9), r"damping must be .* at most 0\.5"),
    "point on its hinge": (
        lambda: Panel(mass=1.0, hinge=[0, 1, 0], axis=[0, 1, 0], arm=[0, 1, 0], frequency=1.0, damping=0.0),
        "needs inertia about its hinge",
    ),
    "panel inertia": (lambda: PANELS.replace(inertia=[1.0, 0.1, 0.1]), "panel inertia must be a rigid body's"),
    "too heavy": (lambda: satellite(TANK.replace(mass=100.0)), "must be lighter than it, 95 kg; got 100 kg"),
    "too much inertia": (
        lambda: satellite(PANELS.replace(mass=5.0)),
        "what is left without them must be that of a rigid",
    ),
    "too many": (lambda: satellite(*[TANK.replace(mass=0.1)] * 9), "at most 8 oscillators"),
    "not a list": (lambda: oscillators_of("panel"), "must be a list of Panel and SloshMass"),
    "not an oscillator": (lambda: oscillators_of([3]), "must be a Panel, a SloshMass or a mapping"),
    "misspelled hinge": (
        lambda: oscillators_of([{**_without(PANELS, "hinge"), "hing": [0, 0.3, 0]}]),
        "unknown setting of Panel 'hing'.*Did you mean 'hinge'",
    ),
    "misspelled direction": (
        lambda: oscillators_of([{**_without(TANK, "direction"), "directon": [0, 0, 1]}]),
        "unknown setting of SloshMass 'directon'.*Did you mean 'direction'",
    ),
    "neither form": (
        lambda: oscillators_of([{"mass": 1.0, "frequency": 0.3, "damping": 0.0}]),
        "a panel has hinge, axis, arm, a slosh mass position and direction; got .'mass', 'frequency', 'damping'.",
    ),
    "above Nyquist": (
        lambda: SatInertiaIDEnv(satellite(PANELS.replace(frequency=6.0))),
        r"must be below half the sampling rate, 5 Hz",
    ),
    "different counts": (lambda: SatInertiaIDEnv([satellite(PANELS), "cubesat"]), "need as many oscillators"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_is_refused(case):
    make, message = REFUSED[case]
    with pytest.raises(ValueError, match=message):
        make()


def test_an_episode_with_other_oscillators_is_refused():
    env = SatInertiaIDEnv(satellite(PANELS))
    with pytest.raises(ValueError, match="as many oscillators as the environment's"):
        env.reset(seed=0, options={"satellite": "cubesat"})
