"""The truth: what mechanics promises, then an independent integrator of the textbook equations, then limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import simpson, solve_ivp
from scipy.spatial.transform import Rotation

from satid_gym import (
    SATELLITES,
    Disturbance,
    InertiaLaw,
    ReactionWheels,
    Satellite,
    SatInertiaIDEnv,
    Trajectory,
    paper_law,
    simulate,
)
from satid_gym.laws import INERTIA_MODES
from satid_gym.plants import law_inertia
from satid_gym.satellite import BENCHMARK_SATELLITES
from tests.cases import cases

NO_TORQUE = Disturbance()
ALL_TORQUES = Disturbance(
    constant=(4e-4, -3e-4, 2e-4),
    cosine=(2e-4, 1e-4, -3e-4),
    sine=(-1e-4, 3e-4, 2e-4),
    gravity_gradient=True,
    solar_force=(1e-3, -5e-4, 2e-4),
    solar_offset=(0.02, -0.03, 0.05),
    orbit_rate=0.02,  # twenty times the real one, so that a wrong nadir shows within two minutes
)
TILTED = np.array([[0.5, 0.1, 0.0], [0.1, 0.4, -0.2], [0.0, -0.2, 0.3]])
LAWS = {
    "static": InertiaLaw("static"),
    "step": InertiaLaw("step", size=0.1, time=61.37),
    "drift": InertiaLaw("drift", size=0.05, time=300.0),
    "periodic": InertiaLaw("periodic", size=0.03, frequency=0.02, phase=0.4),
    "deployment": InertiaLaw("step", time=33.3, change=[[0.5, 0.1, 0.0], [0.1, 0.4, -0.2], [0.0, -0.2, 0.3]]),
    "factors": InertiaLaw("table", times=(10.3, 41.7, 42.1, 95.9, 250.0), values=(0.95, 1.0, 1.07, 1.02, 1.1)),
    "tensors": InertiaLaw("table", times=(0.0, 33.3, 71.1), values=[0.0 * TILTED, 0.3 * TILTED, TILTED]),
}


# Runge-Kutta steps a second where two exact descriptions are compared: the integrator's error stays below 1e-11 rad/s
FINE = 100


def square_wave(satellite: Satellite, seconds: int, amplitude: float = 0.6, period: float = 40.0) -> np.ndarray:
    """Motor torque (seconds, n): one square wave a wheel, staggered, so that every axis turns."""
    n = satellite.wheels.count
    phase = np.arange(seconds)[:, None] / period + np.arange(n) / n
    return amplitude * satellite.wheels.max_torque * np.where(phase % 1.0 < 0.5, 1.0, -1.0)


def factor(law: InertiaLaw, t: float, after_step: bool) -> tuple[float, float]:
    """f and df/dt of J = J0 + f change, transcribed from the paper's laws."""
    if law.mode == "step":
        return float(after_step), 0.0
    if law.mode == "drift":
        return t / law.time, 1.0 / law.time
    if law.mode == "periodic":
        w = 2.0 * np.pi * law.frequency
        return np.sin(w * t + law.phase), w * np.cos(w * t + law.phase)
    return 0.0, 0.0


def table_inertia(law: InertiaLaw, inertia: np.ndarray, t: float) -> np.ndarray:
    """J(t) of a table, entry by entry."""
    knots = [inertia * value if np.ndim(value) == 0 else inertia + value for value in law.values]
    entries = [np.interp(t, law.times, column) for column in np.reshape(knots, (-1, 9)).T]
    return np.reshape(entries, (3, 3))


@dataclass
class Textbook:
    """Euler's equations with wheels in (omega, Omega, body-to-inertial matrix), by DOP853 with located events.

    (J - A j A^T) omega' = tau - J' omega - omega x (J omega + A j Omega) - A u,   Omega' = u / j - A^T omega',
    with A, j and u of the free wheels alone in A j A^T and A u: a wheel held at its speed limit is a part of
    the body whose rotor spins at a constant speed. Source: Wie, Space Vehicle Dynamics and Control, ch. 7.
    """

    satellite: Satellite
    law: InertiaLaw
    disturbance: Disturbance

    def __post_init__(self) -> None:
        self.axes, self.j = self.satellite.wheels.axes, self.satellite.wheels.inertia
        self.n, self.max_speed = len(self.j), self.satellite.wheels.max_speed
        change = self.law.change
        self.change = self.law.size * self.satellite.inertia if change is None else change
        self.held = np.zeros(self.n, bool)
        self.stepped = False
        self.growth = np.zeros((3, 3))

    def inertia(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        if self.law.mode == "table":
            return table_inertia(self.law, self.satellite.inertia, t), self.growth
        f, slope = factor(self.law, t, self.stepped)
        return self.satellite.inertia + f * self.change, slope * self.change

    def external(self, t: float, attitude: np.ndarray, inertia: np.ndarray) -> np.ndarray:
        d = self.disturbance
        tau = d.constant + d.cosine * np.cos(d.orbit_rate * t) + d.sine * np.sin(d.orbit_rate * t)
        tau = tau + np.cross(d.solar_offset, attitude.T @ d.solar_force)
        if d.gravity_gradient:
            nadir = attitude.T @ [np.cos(d.orbit_rate * t), np.sin(d.orbit_rate * t), 0.0]
            tau = tau + 3.0 * d.orbit_rate**2 * np.cross(nadir, inertia @ nadir)
        return tau

    def split(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return y[:3], y[3 : 3 + self.n], y[3 + self.n :].reshape(3, 3)

    def slope(self, t: float, y: np.ndarray, u: np.ndarray) -> np.ndarray:
        omega, speed, attitude = self.split(y)
        inertia, growth = self.inertia(t)
        free = ~self.held
        axes, j = self.axes[:, free], self.j[free]
        momentum = inertia @ omega + self.axes @ (self.j * speed)
        torque = self.external(t, attitude, inertia) - growth @ omega - np.cross(omega, momentum) - axes @ u[free]
        acceleration = np.linalg.solve(inertia - (axes * j) @ axes.T, torque)
        spin = np.zeros(self.n)
        spin[free] = u[free] / j - axes.T @ acceleration
        x, y_, z = omega
        turn = attitude @ np.array([[0.0, -z, y_], [z, 0.0, -x], [-y_, x, 0.0]])
        return np.concatenate([acceleration, spin, turn.ravel()])

    def pushes_outward(self, t: float, y: np.ndarray, u: np.ndarray, k: int) -> float:
        """How far the motor's torque on wheel k exceeds what holds its speed, counted outward."""
        spin = u[k] - self.j[k] * self.axes[:, k] @ self.slope(t, y, u)[:3]
        return float(np.sign(self.split(y)[1][k]) * spin)

    def events(self, u: np.ndarray) -> list:
        def reaches(k):
            def event(t, y):
                return abs(self.split(y)[1][k]) - self.max_speed[k]

            event.terminal, event.direction = True, 1.0
            return event

        def leaves(k):
            def event(t, y):
                return self.pushes_outward(t, y, u, k)

            event.terminal, event.direction = True, -1.0
            return event

        return [leaves(k) if self.held[k] else reaches(k) for k in range(self.n)]

    def interval(self, t: float, end: float, y: np.ndarray, u: np.ndarray) -> np.ndarray:
        """From t to end at constant motor torque u."""
        for k in range(self.n):
            at_limit = abs(self.split(y)[1][k]) > self.max_speed[k] * (1.0 - 1e-10)
            self.held[k] = at_limit and self.pushes_outward(t, y, u, k) >= 0.0

        def slope(t: float, y: np.ndarray) -> np.ndarray:
            return self.slope(t, y, u)

        while t < end:
            stop = end
            if self.law.mode == "step" and not self.stepped:
                stop = min(end, self.law.time)
            if self.law.mode == "table":
                stop = min([end, *(knot for knot in self.law.times if knot > t)])
                after, before = (table_inertia(self.law, self.satellite.inertia, at) for at in (stop, t))
                self.growth = (after - before) / (stop - t)
            solution = solve_ivp(slope, (t, stop), y, "DOP853", events=self.events(u), rtol=1e-12, atol=1e-14)
            assert solution.status >= 0, solution.message
            t, y = solution.t[-1], solution.y[:, -1].copy()
            for k in range(self.n):
                if len(solution.t_events[k]):
                    self.held[k] = not self.held[k]
                    if self.held[k]:
                        y[3 + k] = np.sign(y[3 + k]) * self.max_speed[k]
            if self.law.mode == "step" and not self.stepped and t >= self.law.time:
                y = self.step_inertia(t, y)
        return y

    def step_inertia(self, t: float, y: np.ndarray) -> np.ndarray:
        """Momentum and the free wheels' absolute spin are the same on both sides of a step of J."""
        omega, speed, attitude = self.split(y)
        momentum = self.inertia(t)[0] @ omega + self.axes @ (self.j * speed)
        spin = self.j * (speed + self.axes.T @ omega)
        self.stepped = True
        assert not self.held.any(), "the oracle steps J between free wheels only"
        omega = np.linalg.solve(self.inertia(t)[0] - self.satellite.wheels.rotor_inertia, momentum - self.axes @ spin)
        return np.concatenate([omega, spin / self.j - self.axes.T @ omega, attitude.ravel()])

    def fly(self, torque: np.ndarray, dt: float, omega0: object, speed0: object) -> np.ndarray:
        """States (N + 1, 3 + n + 9)."""
        y = np.concatenate([omega0, speed0, np.eye(3).ravel()])
        out = [y]
        for i, u in enumerate(torque):
            y = self.interval(i * dt, (i + 1) * dt, y, u)
            out.append(y)
        return np.array(out)


def inertial_momentum(flight: Trajectory) -> np.ndarray:
    return Rotation.from_quat(flight.attitude).apply(flight.momentum)


def kinetic_energy(satellite: Satellite, flight: Trajectory) -> np.ndarray:
    """omega^T J omega / 2 + omega^T A j Omega + j Omega^2 / 2, wheels' spin included."""
    j, axes = satellite.wheels.inertia, satellite.wheels.axes
    body = 0.5 * np.einsum("ti,tij,tj->t", flight.omega, flight.inertia, flight.omega)
    coupling = np.einsum("ti,ik,k,tk->t", flight.omega, axes, j, flight.wheel_speed)
    return body + coupling + 0.5 * flight.wheel_speed**2 @ j


# What mechanics promises


@cases("mode", LAWS)
@pytest.mark.parametrize("name", [*SATELLITES, "pyramid"])
@pytest.mark.compiled
def test_momentum_is_conserved_while_wheels_saturate(name, mode, pyramid):
    """Wheels driven into their limits and back, the body tumbling at up to 1 rad/s, J varying."""
    satellite, law = SATELLITES.get(name, pyramid), LAWS[mode]
    wheels = satellite.wheels
    if law.change is not None:
        law = InertiaLaw("step", time=33.3, change=0.07 * satellite.inertia)
    if mode == "tensors":
        law = law.replace(values=[0.0 * satellite.inertia, 0.1 * satellite.inertia, -0.05 * satellite.inertia])
    start = 0.9 * wheels.max_speed * np.resize([1.0, -1.0, 1.0, -1.0], wheels.count)
    torque = np.tile(np.sign(start) * 5.0 * wheels.max_torque, (3000, 1))
    torque[300:] *= -1.0
    flight = simulate(satellite, torque, 0.1, omega0=(0.01, -0.02, 0.015), wheel_speed0=start, law=law)
    assert (np.abs(flight.wheel_speed) >= wheels.max_speed * (1.0 - 1e-9)).any(axis=0).all(), "every wheel saturates"
    momentum = inertial_momentum(flight)
    size = np.linalg.norm(momentum, axis=1)
    assert np.abs(size / size[0] - 1.0).max() < 1e-10
    # its direction carries the attitude's error as well
    assert np.linalg.norm(momentum - momentum[0], axis=1).max() < 1e-9 * size[0]


@pytest.mark.compiled
def test_momentum_is_what_its_definition_says(pyramid):
    flight = simulate(pyramid, square_wave(pyramid, 60), 1.0, omega0=(0.01, -0.02, 0.015), law=LAWS["drift"])
    spin = flight.wheel_speed * pyramid.wheels.inertia
    expected = np.einsum("tij,tj->ti", flight.inertia, flight.omega) + spin @ pyramid.wheels.axes.T
    np.testing.assert_allclose(flight.momentum, expected, rtol=0, atol=1e-13)


@cases("name", ["microsat", "skewed", "pyramid"])
@pytest.mark.compiled
def test_kinetic_energy_is_constant_without_torque(name, request):
    satellite = request.getfixturevalue(name)
    speed = 300.0 * np.resize([1.0, -0.5, 0.7, -0.9], satellite.wheels.count)
    flight = simulate(
        satellite,
        np.zeros((300, satellite.wheels.count)),
        1.0,
        omega0=(0.05, -0.03, 0.04),
        wheel_speed0=speed,
        substeps=FINE,
    )
    energy = kinetic_energy(satellite, flight)
    assert np.abs(energy / energy[0] - 1.0).max() < 1e-9
    # the wheels hold nearly all of that; the body's own share is as constant, for h is (gyroscopic torque does no work)
    rest = satellite.inertia - satellite.wheels.rotor_inertia
    body = 0.5 * np.einsum("ti,ij,tj->t", flight.omega, rest, flight.omega)
    assert np.ptp(flight.omega, axis=0).min() > 0.005, "the body tumbles"
    assert np.abs(body / body[0] - 1.0).max() < 1e-9


def test_only_motors_and_external_torque_do_work(pyramid):
    """dT/dt = u . Omega + tau . omega: nothing in it comes from the gyroscopic torque."""
    torque, tau, dt = square_wave(pyramid, 60), np.array([2e-3, -1e-3, 3e-3]), 0.02
    fine = np.repeat(torque, 50, axis=0)
    flight = simulate(pyramid, fine, dt, omega0=(0.05, -0.04, 0.06), disturbance=tau, substeps=1)
    energy = kinetic_energy(pyramid, flight)
    work = 0.0
    for i in range(60):
        second = slice(50 * i, 50 * i + 51)
        power = flight.wheel_speed[second] @ torque[i] + flight.omega[second] @ tau
        work += simpson(power, dx=dt)
    assert energy[-1] - energy[0] == pytest.approx(work, rel=1e-9)
    assert abs(work) > 1.0


@pytest.mark.compiled
def test_runge_kutta_has_order_four(microsat):
    """Slope of log error over log step, by regression; a tumble fast enough that rounding stays far below."""
    torque = square_wave(microsat, 20, period=8.0)
    start = {"omega0": (0.5, -0.4, 0.3), "wheel_speed0": (100.0, -200.0, 150.0), "law": LAWS["periodic"]}
    exact = simulate(microsat, torque, 1.0, **start, disturbance=ALL_TORQUES, substeps=800)
    counts = np.array([8, 12, 16, 24, 32])  # so fine that none is halved to keep |M|
    errors = []
    for count in counts:
        flight = simulate(microsat, torque, 1.0, **start, disturbance=ALL_TORQUES, substeps=int(count))
        errors.append(np.abs(flight.omega - exact.omega).max())
    order = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert order == pytest.approx(4.0, abs=0.15)


def test_single_axis_in_closed_form(microsat):
    """Rest, one wheel: (J - j) omega = tau t - u t; once the wheel is at its limit, J omega = tau t - j Omega_max."""
    j, limit = microsat.wheels.inertia[2], microsat.wheels.max_speed[2]
    inertia, u, tau = microsat.inertia[2, 2], 0.08, 1e-3
    t = np.arange(61.0)
    torque = np.tile([0.0, 0.0, u], (60, 1))
    flight = simulate(microsat, torque, 1.0, disturbance=(0.0, 0.0, tau))
    omega = (tau - u) * t / (inertia - j)
    speed = u * t / j - omega
    full = speed > limit
    assert 0 < full.sum() < 60
    omega[full], speed[full] = (tau * t[full] - j * limit) / inertia, limit
    np.testing.assert_allclose(flight.omega[:, 2], omega, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(flight.wheel_speed[:, 2], speed, rtol=1e-9)
    np.testing.assert_array_equal(flight.omega[:, :2], 0.0)
    angle = 2.0 * np.arctan2(flight.attitude[:, 2], flight.attitude[:, 3])
    before = ~full
    np.testing.assert_allclose(angle[before], 0.5 * (tau - u) * t[before] ** 2 / (inertia - j), rtol=1e-9, atol=1e-12)


def test_single_axis_with_growing_inertia_in_closed_form(microsat):
    """At rest in total, (J(t) - j) omega = -u t whatever J does on the way: there is no missing dJ/dt term."""
    law, j, u = LAWS["drift"], microsat.wheels.inertia[0], 0.02
    t = np.arange(61.0)
    flight = simulate(microsat, np.tile([u, 0.0, 0.0], (60, 1)), 1.0, law=law)
    inertia = microsat.inertia[0, 0] * (1.0 + 0.05 * t / 300.0)
    np.testing.assert_allclose(flight.omega[:, 0], -u * t / (inertia - j), rtol=1e-9)


@pytest.mark.compiled
def test_symmetric_top_precesses_in_closed_form():
    """Torque-free, the wheels across at rest in space: omega turns about z at ((C - A) omega_z + h) / A.

    A and C are the moments without the wheels' spin inertia, h the absolute spin momentum about z.
    """
    wheels = ReactionWheels(inertia=2e-3, max_torque=0.1, max_speed=900.0)
    satellite = Satellite("top", (5.0, 5.0, 7.0), wheels)
    rest = np.diag(satellite.inertia - wheels.rotor_inertia)
    omega0, speed = np.array([0.03, 0.0, 0.05]), 400.0
    flight = simulate(
        satellite, np.zeros((120, 3)), 1.0, omega0=omega0, wheel_speed0=(-omega0[0], 0.0, speed), substeps=FINE
    )
    spin = 2e-3 * (speed + omega0[2])
    turn = ((rest[2] - rest[0]) * omega0[2] + spin) / rest[0] * flight.time
    expected = np.stack([0.03 * np.cos(turn), 0.03 * np.sin(turn), np.full_like(turn, 0.05)], axis=1)
    np.testing.assert_allclose(flight.omega, expected, rtol=0, atol=1e-10)


@cases("mode", INERTIA_MODES)
@cases(("last_speed", "tolerance"), [(-400.0, 1e-12), (-800.0, 1e-9)])
@pytest.mark.compiled
def test_turning_the_body_frame_changes_nothing(mode, last_speed, tolerance, skewed):
    """Inertia, axes, rates and body-fixed torques in another body frame; attitude makes up for it."""
    turn = Rotation.from_rotvec([0.7, -1.1, 0.4])
    r, d = turn.as_matrix(), ALL_TORQUES
    wheels = skewed.wheels.replace(axes=r @ skewed.wheels.axes)
    turned = skewed.replace(inertia=r @ skewed.inertia @ r.T, wheels=wheels)
    body = {name: r @ getattr(d, name) for name in ("constant", "cosine", "sine", "solar_offset")}
    torque, omega0, speed = square_wave(skewed, 120, 0.3), np.array([0.02, -0.03, 0.01]), (100.0, 0.0, last_speed)
    common = {"wheel_speed0": speed, "law": LAWS[mode], "substeps": FINE}
    here = simulate(skewed, torque, 1.0, omega0=omega0, disturbance=d, **common)
    there = simulate(
        turned,
        torque,
        1.0,
        omega0=r @ omega0,
        attitude0=turn.inv().as_quat(),
        disturbance=d.replace(**body),
        **common,
    )
    assert np.any(np.abs(here.wheel_speed) > 899.999) == (last_speed < -700.0)
    np.testing.assert_allclose(there.omega, here.omega @ r.T, rtol=0, atol=tolerance)
    np.testing.assert_allclose(there.wheel_speed, here.wheel_speed, rtol=0, atol=1e4 * tolerance)
    attitude = (Rotation.from_quat(there.attitude) * turn).as_matrix()
    np.testing.assert_allclose(attitude, Rotation.from_quat(here.attitude).as_matrix(), rtol=0, atol=20 * tolerance)


# The textbook's equations, integrated apart


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
@cases("name", ["microsat", "pyramid"])
@pytest.mark.compiled
def test_equals_the_textbook(name, law, request):
    satellite = request.getfixturevalue(name)
    torque = square_wave(satellite, 120)
    omega0, speed0 = (0.01, -0.02, 0.015), 100.0 * np.resize([1.0, -2.0, 1.5, 0.5], satellite.wheels.count)
    start = {"omega0": omega0, "wheel_speed0": speed0}
    flight = simulate(satellite, torque, 1.0, **start, law=law, disturbance=ALL_TORQUES, substeps=FINE)
    oracle = Textbook(satellite, law, ALL_TORQUES)
    expected = oracle.fly(torque, 1.0, omega0, speed0)
    assert not oracle.held.any()
    np.testing.assert_allclose(flight.omega, expected[:, :3], rtol=0, atol=1e-10)
    np.testing.assert_allclose(flight.wheel_speed, expected[:, 3 : 3 + oracle.n], rtol=0, atol=1e-7)
    matrices = Rotation.from_quat(flight.attitude).as_matrix().reshape(-1, 9)
    np.testing.assert_allclose(matrices, expected[:, 3 + oracle.n :], rtol=0, atol=1e-9)


@pytest.mark.parametrize("mode", ["static", "drift", "periodic", "factors", "tensors"])
@cases("name", ["microsat", "pyramid"])
@pytest.mark.compiled
def test_equals_the_textbook_while_wheels_saturate(name, mode, request):
    """Into the limit with full torque, coasting there with none, gently back, and out again."""
    satellite = request.getfixturevalue(name)
    wheels = satellite.wheels
    side = np.resize([1.0, -1.0, 1.0, -1.0], wheels.count)
    speed0 = wheels.max_speed * side * np.resize([0.7, 0.8, 0.9, 0.6], wheels.count)
    share = np.repeat([1.0, 0.0, 0.3, 0.0, -0.2, 1.0], 20)
    share[23:40:3] = 1e-3
    torque = share[:, None] * side * wheels.max_torque
    omega0 = (0.01, -0.02, 0.015)
    start = {"omega0": omega0, "wheel_speed0": speed0}
    flight = simulate(satellite, torque, 1.0, **start, law=LAWS[mode], disturbance=ALL_TORQUES, substeps=FINE)
    expected = Textbook(satellite, LAWS[mode], ALL_TORQUES).fly(torque, 1.0, omega0, speed0)
    held = np.abs(flight.wheel_speed) > wheels.max_speed * (1.0 - 1e-9)
    assert 0.2 < held.mean() < 0.9, "both regimes are flown"
    np.testing.assert_allclose(flight.omega, expected[:, :3], rtol=0, atol=1e-9)
    np.testing.assert_allclose(flight.wheel_speed, expected[:, 3 : 3 + wheels.count], rtol=0, atol=1e-6)


# The same against the textbook in a second of fast tumble: every term of the equations is large


SHORT_LAWS = {
    "static": InertiaLaw("static"),
    "step": InertiaLaw("step", size=0.1, time=0.4137),
    "drift": InertiaLaw("drift", size=0.3, time=1.3),
    "periodic": InertiaLaw("periodic", size=0.2, frequency=0.4, phase=0.4),
    "deployment": InertiaLaw("step", time=0.33, change=[[0.5, 0.1, 0.0], [0.1, 0.4, -0.2], [0.0, -0.2, 0.3]]),
    "factors": InertiaLaw("table", times=(0.05, 0.31, 0.4137, 0.9), values=(1.0, 1.3, 0.9, 1.2)),
    "tensors": InertiaLaw("table", times=(0.0, 0.33, 0.71), values=[0.1 * TILTED, TILTED, 0.0 * TILTED]),
}
STRONG_TORQUES = Disturbance(
    constant=(0.04, -0.03, 0.02),
    cosine=(0.02, 0.01, -0.03),
    sine=(-0.01, 0.03, 0.02),
    gravity_gradient=True,
    solar_force=(0.1, -0.05, 0.2),
    solar_offset=(0.2, -0.3, 0.5),
    orbit_rate=0.3,
)


@cases("law", SHORT_LAWS.values())
@cases("name", ["skewed", "pyramid"])
def test_a_second_of_tumble_equals_the_textbook(name, law, request):
    satellite = request.getfixturevalue(name)
    torque = square_wave(satellite, 4, period=3.0)
    omega0, speed0 = (0.5, -0.4, 0.3), 300.0 * np.resize([1.0, -0.7, 0.5, 0.6], satellite.wheels.count)
    start = {"omega0": omega0, "wheel_speed0": speed0, "law": law, "disturbance": STRONG_TORQUES}
    flight = simulate(satellite, torque, 0.25, **start, substeps=40)
    oracle = Textbook(satellite, law, STRONG_TORQUES)
    expected = oracle.fly(torque, 0.25, omega0, speed0)
    assert oracle.stepped == (law.mode == "step")
    np.testing.assert_allclose(flight.omega, expected[:, :3], rtol=0, atol=1e-9)
    np.testing.assert_allclose(flight.wheel_speed, expected[:, 3 : 3 + oracle.n], rtol=0, atol=1e-7)
    matrices = Rotation.from_quat(flight.attitude).as_matrix().reshape(-1, 9)
    np.testing.assert_allclose(matrices, expected[:, 3 + oracle.n :], rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(flight.attitude, axis=1), 1.0, rtol=1e-14)
    np.testing.assert_allclose(flight.torque, torque, rtol=1e-9)


@cases("mode", ["static", "drift", "periodic"])
@cases("name", ["skewed", "pyramid"])
def test_a_second_at_the_speed_limit_equals_the_textbook(name, mode, request):
    """Into the limit, coasting there, pulled back, thrown out again; on either side, one wheel after the other."""
    satellite = request.getfixturevalue(name)
    wheels = satellite.wheels
    side = np.resize([1.0, -1.0, 1.0, -1.0], wheels.count)
    speed0 = side * (wheels.max_speed - np.resize([6.0, 9.0, 14.0, 3.0], wheels.count))
    share = np.array([1.0, 0.0, 1e-3, 0.2, -0.4, 1.0])
    torque = share[:, None] * side * wheels.max_torque
    start = {"omega0": (0.4, -0.7, 0.5), "wheel_speed0": speed0, "law": SHORT_LAWS[mode], "disturbance": STRONG_TORQUES}
    flight = simulate(satellite, torque, 0.2, **start, substeps=40)
    expected = Textbook(satellite, SHORT_LAWS[mode], STRONG_TORQUES).fly(torque, 0.2, start["omega0"], speed0)
    held = np.abs(flight.wheel_speed) > wheels.max_speed * (1.0 - 1e-9)
    assert held.any(axis=0).sum() > 1, "more than one wheel gets there"
    assert not held[-2].all(), "and is released"
    np.testing.assert_allclose(flight.omega, expected[:, :3], rtol=0, atol=3e-8)  # releases are met at a step's start
    np.testing.assert_allclose(flight.wheel_speed, expected[:, 3 : 3 + wheels.count], rtol=0, atol=1e-5)


@cases("side", [1.0, -1.0])
def test_a_wheel_thrown_past_its_limit_by_a_step_of_the_inertia_is_locked(side, microsat):
    """J_z jumps to 0.8 of itself: free, the wheel would turn 0.1 rad/s past its limit; the body takes up the rest."""
    wheels, law = microsat.wheels, InertiaLaw("step", time=0.5, change=(0.0, 0.0, -0.2 * microsat.inertia[2, 2]))
    j, limit, inertia, omega0 = wheels.inertia[2], wheels.max_speed[2], microsat.inertia[2, 2], -0.5 * side
    speed0 = np.array([0.0, 0.0, side * (limit - 0.02)])
    flight = simulate(
        microsat, np.zeros((4, 3)), 0.25, omega0=(0.0, 0.0, omega0), wheel_speed0=speed0, law=law, substeps=2
    )
    momentum = inertia * omega0 + j * speed0[2]
    np.testing.assert_allclose(flight.wheel_speed[:2], [speed0, speed0], rtol=1e-12)
    np.testing.assert_allclose(flight.wheel_speed[2:, 2], side * limit, rtol=1e-12)
    np.testing.assert_allclose(flight.omega[2:, 2], (momentum - side * j * limit) / (0.8 * inertia), rtol=1e-12)
    np.testing.assert_allclose(flight.momentum[:, 2], momentum, rtol=1e-12)


def test_a_step_of_the_inertia_between_held_wheels_conserves_momentum(pyramid):
    """J jumps to 0.8 J0 while two of the wheels are held at their limits: the body spins up."""
    limit = pyramid.wheels.max_speed
    speed0 = limit * [1.0, -1.0, 0.9999, -0.9999]
    flight = simulate(
        pyramid,
        np.zeros((4, 4)),
        0.25,
        omega0=(-0.5, 0.4, -0.6),
        wheel_speed0=speed0,
        law=InertiaLaw("step", size=-0.2, time=0.6),
        substeps=10,
    )
    momentum = inertial_momentum(flight)
    size = np.linalg.norm(momentum[0])
    assert np.linalg.norm(momentum - momentum[0], axis=1).max() < 1e-9 * size
    assert (np.abs(flight.wheel_speed) <= limit * (1.0 + 1e-11)).all()
    spin = flight.wheel_speed * pyramid.wheels.inertia
    expected = np.einsum("tij,tj->ti", flight.inertia, flight.omega) + spin @ pyramid.wheels.axes.T
    np.testing.assert_allclose(flight.momentum, expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(flight.inertia[3] / flight.inertia[2], 0.8)


@cases("law", [SHORT_LAWS["static"], InertiaLaw("periodic", size=0.2, frequency=0.3, phase=0.4)])
@cases("name", ["cubesat", "skewed"])
def test_a_coarse_sample_is_flown_in_as_many_steps_as_the_body_turns(name, law, request):
    """Two samples of 10 s: nutation and law turn by several radians in each, which one step could not follow."""
    satellite = SATELLITES[name] if name in SATELLITES else request.getfixturevalue(name)
    coarse = {"decision_period": 20.0, "sample_period": 10.0, "horizon": 200.0, "torque_noise": 0.0}
    calm = {"inertia_std": 0.0, "disturbance_scale": 0.0, "gravity_gradient": False, "solar_pressure": 0.0}
    env = SatInertiaIDEnv(
        satellite, law, {**coarse, **calm, "wheel_speed_range": 0.5, "initial_rate_std": 0.5, "termination_factor": 1e3}
    )
    env.reset(seed=1)
    plant = env.fleet.rows.plants[0]
    start = {"omega0": plant["rate"].copy(), "wheel_speed0": plant["wheel_speed"].copy()}
    action = np.array([0.02, -0.03, 0.01], np.float32)
    env.step(action)
    torque = action[None].astype(float) * satellite.wheels.max_torque
    flight = simulate(
        satellite, torque, 20.0, **start, attitude0=(0.0, 0.0, 0.0, 1.0), law=law, disturbance=NO_TORQUE, substeps=2000
    )
    assert plant["time"] == 20.0
    np.testing.assert_allclose(plant["rate"], flight.omega[-1], rtol=0, atol=5e-6 * np.abs(flight.omega).max())


@cases("name", BENCHMARK_SATELLITES)
def test_a_step_that_would_not_keep_momentum_is_halved(name):
    """One step is asked for, in which the momentum turns too far for it; |M| stays all the same."""
    satellite = SATELLITES[name]
    speed = 0.9 * satellite.wheels.max_speed * [1.0, -1.0, 1.0]
    torque = np.zeros((20, 3))
    flight = simulate(
        satellite, torque, 4.0, omega0=(0.3, -0.4, 0.2), wheel_speed0=speed, substeps=1, disturbance=NO_TORQUE
    )
    turned = np.arccos(np.sum(flight.momentum[1:] * flight.momentum[:-1], axis=1) / np.sum(flight.momentum[0] ** 2))
    assert turned.min() > 0.05  # rad between two rows
    size = np.linalg.norm(flight.momentum, axis=1)
    assert np.abs(np.diff(size)).max() < 1e-7 * size[0]


@cases("rate", [1e7, 1e60, 1e160])
def test_a_body_too_fast_for_any_step_ends_all_the_same(rate):
    """Halving cannot help where momentum overflows; the call must return."""
    flight = simulate(SATELLITES["microsat"], np.zeros((1, 3)), 1.0, omega0=(rate, -rate, 0.5 * rate), substeps=1)
    assert flight.time[-1] == 1.0


# The default step, in intervals of a second


@pytest.fixture(scope="module")
def heavy_wheels() -> dict[str, tuple[Trajectory, Trajectory]]:
    """Two minutes with the wheels at 0.8 of their limit, by default and in 40 times as many steps."""
    flights = {}
    for name, satellite in SATELLITES.items():
        start = {"omega0": (0.01, -0.02, 0.015), "wheel_speed0": 0.8 * satellite.wheels.max_speed * [1.0, -1.0, 1.0]}
        torque = square_wave(satellite, 120, 0.3)
        flights[name] = (
            simulate(satellite, torque, 1.0, **start),
            simulate(satellite, torque, 1.0, **start, substeps=400),
        )
    return flights


@cases("name", BENCHMARK_SATELLITES)
@pytest.mark.compiled
def test_default_substeps_are_good_for_1e8_rad_per_s(name, heavy_wheels):
    default, fine = heavy_wheels[name]
    assert np.abs(default.omega - fine.omega).max() < 1e-8


@cases("name", BENCHMARK_SATELLITES)
@pytest.mark.compiled
def test_default_substeps_conserve_momentum(name):
    satellite = SATELLITES[name]
    flight = simulate(satellite, square_wave(satellite, 300, 1.0), 1.0, omega0=(0.01, -0.02, 0.015))
    size = np.linalg.norm(flight.momentum, axis=1)
    assert np.abs(size / size[0] - 1.0).max() < 1e-10


# Limits


@pytest.mark.compiled
@settings(max_examples=60)
@given(data=st.data())
def test_no_command_gets_past_the_limits(data):
    satellite = SATELLITES[data.draw(st.sampled_from(sorted(SATELLITES)))]
    wheels = satellite.wheels
    mode = data.draw(st.sampled_from(INERTIA_MODES))
    share = st.floats(-1e3, 1e3) | st.sampled_from([-1.0, 0.0, 1.0])
    commands = data.draw(st.lists(st.tuples(share, share, share), min_size=1, max_size=12))
    speed0 = np.array(data.draw(st.tuples(*[st.floats(-1.0, 1.0)] * 3))) * wheels.max_speed
    omega0 = np.array(data.draw(st.tuples(*[st.floats(-1.0, 1.0)] * 3))) * 0.2
    torque = np.array(commands) * wheels.max_torque
    law = InertiaLaw("step", size=0.1, time=2.5) if mode == "step" else LAWS[mode]
    flight = simulate(satellite, torque, 1.0, omega0=omega0, wheel_speed0=speed0, law=law)
    assert np.isfinite(flight.omega).all()
    assert (np.abs(flight.torque) <= wheels.max_torque).all()
    # rounding alone: one part in 10^11
    assert (np.abs(flight.wheel_speed) <= wheels.max_speed * (1.0 + 1e-11)).all()
    if mode != "step":  # at a step of J the wheels' spin jumps against the body
        spin = wheels.inertia * (flight.wheel_speed + flight.omega @ wheels.axes)
        assert (np.abs(np.diff(spin, axis=0)) <= wheels.max_torque * (1.0 + 1e-9)).all()


def test_a_torque_within_the_limits_is_applied_as_commanded(pyramid):
    torque = square_wave(pyramid, 20)
    flight = simulate(pyramid, torque, 1.0)
    np.testing.assert_allclose(flight.torque, torque, rtol=1e-9)


# The inertia laws


@cases("law", LAWS.values())
@pytest.mark.compiled
def test_plant_flies_the_law_it_is_scored_against(law, skewed):
    flight = simulate(skewed, square_wave(skewed, 300), 1.0, law=law)
    change = law.size * skewed.inertia if law.change is None else law.change
    after = flight.time >= law.time
    f = np.array([factor(law, t, late)[0] for t, late in zip(flight.time, after, strict=True)])
    expected = skewed.inertia + f[:, None, None] * change
    if law.mode == "table":
        expected = np.array([table_inertia(law, skewed.inertia, t) for t in flight.time])
    np.testing.assert_allclose(flight.inertia, expected, rtol=1e-12)
    np.testing.assert_allclose(law_inertia(law, skewed.inertia, flight.time), expected, rtol=1e-12)


def test_a_static_law_has_no_use_for_its_size(microsat):
    law, t = InertiaLaw("static", size=0.5), np.array([0.0, 3.0, 400.0])
    np.testing.assert_array_equal(law_inertia(law, microsat.inertia, t), np.tile(microsat.inertia, (3, 1, 1)))
    flight = simulate(microsat, np.zeros((2, 3)), 1.0, law=law, substeps=1)
    np.testing.assert_array_equal(flight.inertia, np.tile(microsat.inertia, (3, 1, 1)))


def test_paper_laws():
    """Section IV of the paper: step to 1.1 J0 at T/2, drift by 5 % over T, 3 % at 0.02 Hz."""
    t = np.array([0.0, 12.5, 149.0, 150.0, 300.0])
    scale = {
        "static": [1.0, 1.0, 1.0, 1.0, 1.0],
        "step": [1.0, 1.0, 1.0, 1.1, 1.1],
        "drift": [1.0, 1.0 + 0.05 * 12.5 / 300.0, 1.0 + 0.05 * 149.0 / 300.0, 1.025, 1.05],
        "periodic": [1.0, 1.03, 1.0 + 0.03 * np.sin(2 * np.pi * 2.98), 1.0, 1.0],
    }
    for mode, factors in scale.items():
        moments = law_inertia(paper_law(mode), (6.0, 5.0, 4.0), t)
        np.testing.assert_allclose(moments, np.array(factors)[:, None, None] * np.diag([6.0, 5.0, 4.0]), rtol=1e-12)


# What simulate() refuses


@cases(
    ("changes", "message"),
    [
        ({"torque": np.zeros((5, 4))}, r"torque must have shape \(N, 3\), got \(5, 4\)"),
        ({"torque": [[0.0, np.nan, 0.0]]}, "torque must be finite"),
        ({"torque": "full ahead"}, "torque must be numeric"),
        ({"dt": 0.0}, "dt must be finite and more than 0"),
        ({"dt": np.inf}, "dt must be finite"),
        ({"substeps": 0}, "substeps must be an integer of at least 1"),
        ({"substeps": 2.5}, "substeps must be an integer of at least 1"),
        ({"omega0": (0.0, 0.0)}, r"omega0 must have shape \(3,\)"),
        ({"wheel_speed0": (0.0, 0.0, 901.0)}, r"wheel_speed0 must be within \+-\[900.0, 900.0, 900.0\]"),
        ({"attitude0": (0.0, 0.0, 0.0, 0.0)}, "attitude0 must be a quaternion of nonzero length"),
        ({"disturbance": (1.0, np.inf, 0.0)}, "disturbance must be finite"),
        ({"law": InertiaLaw("step", time=2.0, change=(20.0, 0.0, 0.0))}, "triangle inequality"),
        ({"law": InertiaLaw("periodic", change=(7.0, 7.0, 7.0), frequency=0.1)}, "positive definite"),
        (
            {"law": InertiaLaw("table", times=(0.0, 2.0), values=[(0.0, 0.0, 0.0), (20.0, 0.0, 0.0)], name="boom")},
            "inertia of microsat at 2 s of its boom breaks the triangle inequality",
        ),
    ],
)
def test_simulate_says_what_is_wrong(changes, message, microsat):
    arguments = {"torque": np.zeros((5, 3)), "dt": 1.0} | changes
    with pytest.raises(ValueError, match=message):
        simulate(microsat, **arguments)


def test_wheels_that_the_law_drives_from_limit_to_limit_end_their_flight():
    """Limits of 5e-5 rad/s: a locked wheel is released and held again at the same instant, which once never ended."""
    wheels = ReactionWheels(inertia=(1.4, 1.4, 2.3), max_torque=8e-4, max_speed=(4.5e-5, 4.6e-5, 2.8e-5))
    ball = Satellite("ball", (11.3, 11.3, 11.3), wheels=wheels, rate_limit=0.05)
    law = InertiaLaw("periodic", size=0.4, frequency=0.036, phase=-2.4)
    flight = simulate(ball, np.zeros((3000, 3)), 1.0, omega0=(-0.023, -0.007, 0.031), law=law, substeps=1)
    size = np.linalg.norm(flight.momentum, axis=1)
    np.testing.assert_allclose(size, size[0], rtol=1e-9)
    assert (np.abs(flight.wheel_speed) <= wheels.max_speed).all()
    assert (np.abs(np.diff(np.sign(flight.wheel_speed), axis=0)).sum(axis=0) > 200).all()
