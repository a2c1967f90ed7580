"""Truth and filter against Basilisk, an independent simulator (https://avslab.github.io/basilisk/).

A lane of its own: `make test-basilisk` installs Basilisk and runs it.
"""

import functools
import json
import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from baselines.command import cli
from baselines.identification.recorded import slews
from baselines.studies import basilisk as study
from baselines.studies.worlds.satellites import on_pyramid
from satid_gym import (
    SATELLITES,
    Pilot,
    ReactionWheels,
    Satellite,
    SatInertiaIDEnv,
    Scenario,
    Sensors,
    StarTracker,
    Tolerances,
    simulate,
)
from satid_gym.appendages import panel_pair
from satid_gym.core import kernels
from satid_gym.core.observation import MODE_PLACES
from satid_gym.estimators import AdaptiveEKF
from satid_gym.evaluation import fly, seeds
from satid_gym.fleet import Fleet
from satid_gym.friction import WheelFriction
from satid_gym.identification import identify
from satid_gym.oscillators import Oscillator, Panel
from satid_gym.policies import find
from satid_gym.policies.rate_square import RateSquarePolicy
from satid_gym.policies.shaped_square import ShapedSquarePolicy
from satid_gym.problem import problem
from satid_gym.scenario import prior_of
from satid_gym.star_tracker import earth_angle
from satid_gym.telemetry import Log
from satid_gym.truth import Episode
from satid_gym.truth.kernels import draw
from tests.flexible import BOOM, PANELS, TANK, TOLD, tensor_errors

try:
    from satid_gym.basilisk import BasiliskTruth
except ModuleNotFoundError:  # it has a lane of its own
    pytest.skip("Basilisk is not installed: make test-basilisk", allow_module_level=True)

pytestmark = pytest.mark.basilisk

PERIOD = 0.1  # s, of a sample


@functools.cache
def spline_weights(count: int) -> np.ndarray:
    """Weights (count,) of values over a sample, evenly spread, in the integral of the cubic spline through them."""
    return CubicSpline(np.linspace(0.0, PERIOD, count), np.eye(count)).integrate(0.0, PERIOD)


class Measured(BasiliskTruth):
    """Basilisk with its IMU, whose errors are scale, then misalignment by a rotation of the platform, then bias.

    With `records` the angles that body and wheels turn through are known, which takes time.
    """

    def __init__(
        self, gyro_scale=(1.0,) * 3, gyro_rotation=(0.0,) * 3, gyro_bias=(0.0,) * 3, records=False, **settings
    ):
        super().__init__(**settings)
        self.gyro_scale, self.gyro_rotation, self.gyro_bias = map(np.asarray, (gyro_scale, gyro_rotation, gyro_bias))
        self.records = records

    def begin(self, satellite: Satellite, wheel_speed: np.ndarray, rate: np.ndarray | None = None) -> None:
        rate = np.zeros(3) if rate is None else rate
        self.start(Episode(satellite=satellite, rate=rate, wheel_speed=wheel_speed, sample_period=PERIOD))

    def observe(self, process) -> None:
        from Basilisk.simulation import imuSensor
        from Basilisk.utilities import macros

        process.addTask(self.sim.CreateNewTask("sensors", macros.sec2nano(PERIOD)))
        self.imu = imuSensor.ImuSensor()
        self.imu.setBodyToPlatformDCM(*(float(angle) for angle in self.gyro_rotation[::-1]))  # yaw, pitch, roll
        self.imu.senRotBias = self.gyro_bias.tolist()
        self.imu.gyroScale, self.imu.accelScale = self.gyro_scale.tolist(), [1.0, 1.0, 1.0]
        self.imu.scStateInMsg.subscribeTo(self.body.scStateOutMsg)
        self.sim.AddModelToTask("sensors", self.imu, 1)
        messages = (self.body.scStateOutMsg, self.wheels.rwSpeedOutMsg) if self.records else ()
        self.paths = tuple(message.recorder() for message in messages)
        for path in self.paths:
            self.sim.AddModelToTask("dynamics", path)

    def readings(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """True rate (3,), gyro (3,) without noise and wheel speeds (n,), rad/s."""
        state = self.state()
        return state.rate, np.array(self.imu.sensorOutMsg.read().AngVelPlatform), state.wheel_speed

    def turned(self) -> tuple[np.ndarray, np.ndarray]:
        """Angles that the body (3,) and the wheels (n,) have turned through in the last sample, rad."""
        body, wheels = self.paths
        path = np.hstack([body.omega_BN_B, np.array(wheels.wheelSpeeds)[:, : len(self.before) - 3]])
        path = np.vstack([self.before, path])
        angle = spline_weights(len(path)) @ path
        return angle[:3], angle[3:]

    def push_on(self, torque: np.ndarray) -> None:
        """A sample period of constant motor torque (n,), N m."""
        if self.records:
            rate, _, speed = self.readings()
            self.before = np.concatenate([rate, speed])
        for path in self.paths:
            path.clear()
        self.advance(torque, np.zeros(3), PERIOD)


def test_four_wheels_and_a_full_tensor_move_as_in_basilisk():
    """300 s of motor torque that changes every 2.5 s."""
    c, s = np.cos(0.6), np.sin(0.6)
    axes = np.array([[c, 0.0, -c, 0.0], [0.0, c, 0.0, -c], [s, s, s, s]])
    wheel_inertia = np.array([2e-3, 2.1e-3, 1.9e-3, 2e-3])
    inertia = np.array([[6.5, 0.2, -0.1], [0.2, 6.0, 0.3], [-0.1, 0.3, 4.5]])
    rate, speed = np.array([0.01, -0.02, 0.015]), np.array([100.0, -50.0, 80.0, 20.0])
    pushes = np.random.default_rng(0).uniform(-0.05, 0.05, (60, 1, 4))
    torque = np.repeat(np.concatenate([pushes, -pushes], axis=1).reshape(120, 4), 25, axis=0)
    wheels = ReactionWheels(axes=axes, inertia=wheel_inertia, max_torque=1.0, max_speed=1e5)
    body = Satellite("body", inertia, wheels)
    theirs, seen = Measured(step=0.01), []
    theirs.begin(body, speed, rate)
    for row in torque:
        seen.append(theirs.readings())
        theirs.push_on(row)
    ours = simulate(body, torque, PERIOD, omega0=rate, wheel_speed0=speed)
    rates, _, speeds = (np.array(values) for values in zip(*seen, strict=True))
    assert np.ptp(rates) > 0.05
    np.testing.assert_allclose(ours.omega[:-1], rates, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(ours.wheel_speed[:-1], speeds, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("oscillators", [(PANELS,), (TANK,), (PANELS, BOOM, TANK)], ids=["panels", "slosh", "all"])
def test_panels_and_slosh_move_as_in_basilisk(oscillators):
    """300 s of motor torque that changes every 2.5 s, deflections of several degrees; three wheels."""
    inertia = np.array([[6.5, 0.2, -0.1], [0.2, 6.0, 0.3], [-0.1, 0.3, 4.5]])
    rate, speed, rotors = np.array([0.01, -0.02, 0.015]), np.array([100.0, -50.0, 80.0]), np.full(3, 2e-3)
    pushes = np.random.default_rng(0).uniform(-0.1, 0.1, (60, 1, 3))
    torque = np.repeat(np.concatenate([pushes, -pushes], axis=1).reshape(120, 3), 25, axis=0)
    wheels = ReactionWheels(inertia=rotors, max_torque=1.0, max_speed=1e5)
    body = Satellite("body", inertia, wheels, mass=95.0, oscillators=oscillators)
    theirs, seen, bent = Measured(step=0.005), [], []
    theirs.begin(body, speed, rate)
    for row in torque:
        seen.append(theirs.readings()[0])
        bent.append(theirs.state().deflection)
        theirs.push_on(row)
    ours = simulate(body, torque, PERIOD, omega0=rate, wheel_speed0=speed)
    np.testing.assert_allclose(ours.omega[:-1], seen, rtol=0.0, atol=1e-8)
    assert np.abs(bent).max(axis=0).min() > (0.02 if oscillators == (PANELS,) else 1e-3)
    np.testing.assert_allclose(ours.deflection[:-1], bent, rtol=0.0, atol=1e-6)


def test_wheels_that_rub_move_as_in_basilisk():
    """300 s: from rest through the stiction, then up and down again under torque that changes every 2.5 s.

    Basilisk's stiction acts on a wheel that leaves rest; one that slows down again has Coulomb's friction alone, so the
    wheels do not come back below some times the speed at which stiction has gone.
    """
    friction = WheelFriction(coulomb=4e-3, static=6e-3, viscous=1.6e-5, stribeck_speed=6.0)
    axes, wheel_inertia = np.eye(3), np.array([2e-3, 2.1e-3, 1.9e-3])
    inertia = np.array([[6.5, 0.2, -0.1], [0.2, 6.0, 0.3], [-0.1, 0.3, 4.5]])
    pushes = np.random.default_rng(0).uniform(0.0, 0.05, (59, 1, 3))
    changes = np.concatenate([np.full((2, 3), 0.07), np.stack([pushes, -pushes], axis=1).reshape(118, 3) + 7e-3])
    torque = np.repeat(changes, 25, axis=0)
    wheels = ReactionWheels(axes=axes, inertia=wheel_inertia, max_torque=1.0, max_speed=1e5, friction=friction)
    body = Satellite("body", inertia, wheels)
    theirs, seen = Measured(step=0.002), []
    theirs.begin(body, np.zeros(3))
    for row in torque:
        seen.append(theirs.readings())
        theirs.push_on(row)
    ours = simulate(body, torque, PERIOD)
    rates, _, speeds = (np.array(values) for values in zip(*seen, strict=True))
    assert np.ptp(rates) > 0.05
    assert speeds[50:].min() > 54.0
    print(f"rates agree to {np.abs(ours.omega[:-1] - rates).max():.1e} rad/s")
    np.testing.assert_allclose(ours.omega[:-1], rates, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(ours.wheel_speed[:-1], speeds, rtol=0.0, atol=1e-4)


class Encoder:
    """Basilisk's encoder of each wheel: pulses of an angle, and what is left over goes into the next count.

    It takes the wheel speed of an instant for that of the whole sample, so it is given the sample's mean.
    """

    def __init__(self, pulses: int, wheels: int) -> None:
        from Basilisk.architecture import messaging
        from Basilisk.simulation import encoder
        from Basilisk.utilities import SimulationBaseClass, macros

        self.nanoseconds, self.wheels, self.samples = macros.sec2nano, wheels, 0
        self.sim = SimulationBaseClass.SimBaseClass()
        self.sim.CreateNewProcess("process").addTask(self.sim.CreateNewTask("sensors", macros.sec2nano(PERIOD)))
        self.encoder = encoder.Encoder()
        self.encoder.clicksPerRotation, self.encoder.numRW = pulses, wheels
        self.speed = messaging.RWSpeedMsgPayload()
        self.message = messaging.RWSpeedMsg().write(self.speed)
        self.encoder.rwSpeedInMsg.subscribeTo(self.message)
        self.sim.AddModelToTask("sensors", self.encoder)
        self.sim.InitializeSimulation()
        self(np.zeros(wheels))  # it gives out its first reading as it is

    def __call__(self, angle: np.ndarray) -> np.ndarray:
        """Wheel speeds (n,) as counted where the wheels turn through angles (n,) in the sample."""
        self.speed.wheelSpeeds = [*(angle / PERIOD).tolist(), *[0.0] * (36 - self.wheels)]
        self.message.write(self.speed, self.sim.TotalSim.CurrentNanos)
        self.sim.ConfigureStopTime(self.nanoseconds(self.samples * PERIOD))
        self.sim.ExecuteSimulation()
        self.samples += 1
        return np.array(self.encoder.rwSpeedOutMsg.read().wheelSpeeds)[: self.wheels]


def test_readings_are_those_of_basilisks_sensors():
    """Without noise, sample by sample: the gyro's increments, one of its two samples late; the encoder's counts."""
    quiet = Scenario(
        sensors=Sensors(gyro_integrates=True, gyro_delay=1.0, encoder_pulses=24),
        torque_noise=0.0,
        gyro_noise_std=0.0,
        gyro_bias_walk=0.0,
        disturbance_scale=0.0,
        solar_pressure=0.0,
        gravity_gradient=False,
        estimator="momentum",
    )
    fleet = Fleet(problem("microsat", "static", quiet), 1)
    fleet.rows.plants["stream"][0] = 1, 2, 3, 4
    draw(fleet.rows, fleet.templates.records)
    plant, generator = fleet.rows.plants[0], np.random.default_rng(0)
    wheels = SATELLITES["microsat"].wheels.replace(axes=plant["axes"], inertia=plant["wheel_inertia"])
    theirs = Measured(records=True)
    theirs.begin(
        Satellite("body", plant["inertia"], wheels), wheel_speed=plant["wheel_speed"].copy(), rate=plant["rate"].copy()
    )
    encoder, pulse = Encoder(24, 3), 2.0 * np.pi / 24.0
    ours, angles, bent, counts = [], [], [], np.zeros((2, 3))
    for k in range(200):
        if k % 5 == 0:
            fleet.work["torque"][0] = torque = generator.uniform(-0.1, 0.1, 3)
        kernels.sample(fleet.rows, fleet.work)
        theirs.push_on(torque)
        body, wheels = theirs.turned()
        ours.append(plant["gyro"] * PERIOD)
        angles.append(body)
        bent.append(np.array(theirs.imu.sensorOutMsg.read().DRFramePlatform))
        counts += np.array([plant["tachometer"], encoder(wheels)]) * PERIOD / pulse
        assert np.abs(counts[0] - counts[1]).max() < 1.0 + 1e-6
    np.testing.assert_allclose(ours[1:], angles[:-1], rtol=0.0, atol=1e-11)
    # the IMU gives the turn of the frame, which differs from the sum of the increments by coning
    coning = 0.5 * PERIOD * np.abs(np.diff(angles, axis=0)).max() * np.abs(angles).max() / PERIOD
    assert 1e-9 < np.abs(np.array(angles) - bent).max() < coning


class Watched(BasiliskTruth):
    """Basilisk with its star tracker, without noise, and the angles between a boresight, the Sun and the Earth."""

    def __init__(self, boresight, sun, orbit_rate):
        super().__init__()
        self.boresight, self.sun, self.orbit_rate = boresight, sun, orbit_rate

    def observe(self, process) -> None:
        from Basilisk.architecture import messaging
        from Basilisk.simulation import boreAngCalc, starTracker
        from Basilisk.utilities import macros

        process.addTask(self.sim.CreateNewTask("sensors", macros.sec2nano(PERIOD)))
        self.tracker, self.to_sun, self.to_earth = starTracker.StarTracker(), *(boreAngCalc.BoreAngCalc() for _ in "se")
        self.planet = messaging.SpicePlanetStateMsgPayload()
        self.message = messaging.SpicePlanetStateMsg()
        self._move_earth(0.0)
        self.to_sun.inertialHeadingVec_N = self.sun[:, None].tolist()
        self.to_earth.celBodyInMsg.subscribeTo(self.message)
        for model in (self.to_sun, self.to_earth):
            model.boreVec_B = self.boresight[:, None].tolist()
        for model in (self.tracker, self.to_sun, self.to_earth):
            model.scStateInMsg.subscribeTo(self.body.scStateOutMsg)
            self.sim.AddModelToTask("sensors", model)

    def _move_earth(self, time) -> None:
        angle = self.orbit_rate * time
        self.planet.PositionVector = [7e6 * np.cos(angle), 7e6 * np.sin(angle), 0.0]  # the satellite is at the origin
        self.message.write(self.planet)

    def advance(self, torque, disturbance, duration):
        self._move_earth(self.time + duration)
        return super().advance(torque, disturbance, duration)

    def seen(self) -> tuple[Rotation, float, float]:
        """Reading of the star tracker, body to inertial, and angles of Sun and Earth from the boresight, rad."""
        w, x, y, z = self.tracker.sensorOutMsg.read().qInrtl2Case
        angles = (model.angOutMsg.read().missAngle for model in (self.to_sun, self.to_earth))
        return Rotation.from_quat([x, y, z, w]), *angles


def test_a_star_tracker_reads_as_basilisks():
    """Without noise, sample by sample: the attitude, and whether Sun or Earth are too near by boreAngCalc's angles."""
    sheet = StarTracker(
        boresight=[0.6, 0.0, 0.8],
        across_std=0.0,
        round_std=0.0,
        period=PERIOD,
        reacquire=0.0,
        sun_exclusion=0.9,
        earth_exclusion=0.2,
    )
    quiet = Scenario(
        sensors=Sensors(star_tracker=sheet),
        torque_noise=0.0,
        disturbance_scale=0.0,
        solar_pressure=0.0,
        gravity_gradient=False,
    )
    fleet = Fleet(problem("microsat", "static", quiet), 1)
    fleet.rows.plants["stream"][0] = 1, 2, 3, 4
    draw(fleet.rows, fleet.templates.records)
    plant, generator = fleet.rows.plants[0], np.random.default_rng(0)
    wheels = SATELLITES["microsat"].wheels.replace(axes=plant["axes"], inertia=plant["wheel_inertia"])
    theirs = Watched(sheet.boresight, plant["tracker"]["sun"].copy(), quiet.orbit_rate)
    start = {name: plant[name].copy() for name in ("rate", "wheel_speed", "attitude")}
    theirs.start(Episode(satellite=Satellite("body", plant["inertia"], wheels), sample_period=PERIOD, **start))
    limb = earth_angle(quiet.orbit_rate)
    seen = []
    for k in range(1200):
        if k % 60 == 0:
            fleet.work["torque"][0] = torque = generator.uniform(-0.1, 0.1, 3)
        kernels.sample(fleet.rows, fleet.work)
        theirs.advance(torque, np.zeros(3), PERIOD)
        attitude, to_sun, to_earth = theirs.seen()
        bright, dark = to_sun < sheet.sun_exclusion, to_earth < limb + sheet.earth_exclusion
        assert plant["tracker"]["tracks"] == (not bright and not dark)
        seen.append((bright, dark))
        if not bright and not dark:
            off = attitude.inv() * Rotation.from_quat(plant["tracker"]["reading"])
            assert off.magnitude() < 1e-8
    assert {(False, False), (True, False), (False, True)} <= set(seen)


def flight(
    seed: int,
    tolerances: Tolerances,
    *,
    coulomb: float = 0.0,
    sensors: Sensors | None = None,
    oscillators: tuple[Oscillator, ...] = (),
) -> tuple[float, float]:
    """Mean NEES after 30 s and final relative error of the default filter on 120 s of Basilisk's truth.

    Microsat, inertia and oscillators drawn as an episode's are, square waves of rate by its three wheels; the sensors'
    noise is drawn here.
    """
    generator, nominal = np.random.default_rng([seed, 17]), SATELLITES["microsat"].replace(oscillators=oscillators)
    t, wheels = tolerances, nominal.wheels
    inertia = np.diag(np.diag(nominal.inertia) * np.exp(0.15 * generator.normal(size=3)))
    while 2.0 * np.max(np.diag(inertia)) >= np.trace(inertia):
        inertia = np.diag(np.diag(nominal.inertia) * np.exp(0.15 * generator.normal(size=3)))
    tilt = t.wheel_alignment * generator.normal(size=(3, 3)) * (1.0 - np.eye(3))
    axes = wheels.axes + tilt
    built = wheels.replace(
        axes=axes / np.linalg.norm(axes, axis=0),
        inertia=wheels.inertia * (1.0 + t.wheel_inertia * generator.normal(size=3)),
        friction=WheelFriction(coulomb=coulomb),
    )
    wheel_speed = generator.uniform(-100.0, 100.0, 3)
    theirs = Measured(
        gyro_scale=1.0 + t.gyro_scale * generator.normal(size=3),
        gyro_rotation=t.gyro_alignment * generator.normal(size=3),
        gyro_bias=t.gyro_bias * generator.normal(size=3),
        records=sensors is not None,
    )
    own = tuple(drawn(o, generator) for o in oscillators)
    theirs.begin(Satellite("body", inertia, built, mass=95.0, oscillators=own), wheel_speed)
    sensors = sensors or Sensors()
    world = Scenario(tolerances=tolerances, sensors=sensors, gravity_gradient=False, disturbance_scale=0.1)
    prior = prior_of(nominal, world)
    encoder = Encoder(sensors.encoder_pulses, 3) if sensors.encoder_pulses is not None else None
    late: list[np.ndarray] = []
    estimator, nees, error = AdaptiveEKF(), [], np.nan
    signs = np.array([1.0, -1.0, 1.0])
    for k in range(1200):
        _, gyro, speed = theirs.readings()
        body, wheel = theirs.turned() if theirs.records and k > 0 else (PERIOD * gyro, PERIOD * speed)
        gyro = (body / PERIOD if sensors.gyro_integrates else gyro) + prior.gyro_noise_std * generator.normal(size=3)
        noisy = speed + prior.tachometer_noise_std * generator.normal(size=3)
        late.append(encoder(wheel) if encoder is not None else noisy)
        speed = late[max(k - int(sensors.tachometer_delay), 0)]
        if k == 1:  # Basilisk's IMU has no reading at time 0
            estimator.reset(prior, gyro, speed)
        elif k > 1:
            estimator.predict(speed, PERIOD)
            estimator.update(gyro, speed)
        if k >= 300:
            record, truth = estimator.record, np.diag(inertia)
            theta = record["mean"][3:6]
            covariance = record["covariance"][3:6, 3:6] + record["scale_variance"] * np.outer(theta, theta)
            nees.append((theta - truth) @ np.linalg.solve(covariance, theta - truth) / 3.0)
            error = float(np.linalg.norm(theta - truth) / np.linalg.norm(truth))
        if k % 10 == 0:  # a decision: halfway to the wanted rate, with torque noise each sample
            wanted = 0.02 * np.where((k // 10 + np.array([0, 4, 8])) % 12 < 6, signs, -signs)
            push = -np.clip(0.5 * np.diag(nominal.inertia) * (wanted - gyro), -0.1, 0.1)
        theirs.push_on(np.clip(push + 0.005 * generator.normal(size=3), -0.1, 0.1))
    return float(np.mean(nees)), error


def drawn(oscillator: Oscillator, generator: np.random.Generator) -> Oscillator:
    """An oscillator as built, off nominal as its data sheet says."""
    o = oscillator
    mass, frequency, damping = np.exp(np.array([o.mass_std, o.frequency_std, o.damping_std]) * generator.normal(size=3))
    changes = {"mass": mass * o.mass, "frequency": frequency * o.frequency, "damping": damping * o.damping}
    return o.replace(**changes, inertia=mass * o.inertia) if isinstance(o, Panel) else o.replace(**changes)


STD = {"mass_std": 0.2, "frequency_std": 0.3, "damping_std": 0.3}
LIGHT = PANELS.replace(mass=0.36, hinge=[0, 0.3, 0], inertia=[0.0432, 0.0, 0.0432], **STD)  # a tenth of Jzz
FLIGHTS = {
    "exact": {},
    "gyro bias 1e-3": {"tolerances": Tolerances(gyro_bias=1e-3)},
    "gyro scale 1 %": {"tolerances": Tolerances(gyro_scale=1e-2)},
    "gyro misaligned 3 mrad": {"tolerances": Tolerances(gyro_alignment=3e-3)},
    "rotor inertia 1 %": {"tolerances": Tolerances(wheel_inertia=1e-2)},
    "wheel axes 5 mrad": {"tolerances": Tolerances(wheel_alignment=5e-3)},
    "all small errors": {
        "tolerances": Tolerances(
            gyro_bias=1e-4, gyro_scale=1e-3, gyro_alignment=1e-3, wheel_inertia=1e-3, wheel_alignment=1e-3
        )
    },
    "integrating gyro": {"sensors": Sensors(gyro_integrates=True)},
    "tachometers one sample late": {"sensors": Sensors(tachometer_delay=1.0)},
    "24 pulses": {"sensors": Sensors(gyro_integrates=True, encoder_pulses=24)},
    "24 pulses, gyro of the instant, one sample late": {"sensors": Sensors(encoder_pulses=24, tachometer_delay=1.0)},
    "friction 10 mN m, not told": {"coulomb": 0.01},
    **{f"panels 10 % {f} Hz": {"oscillators": (LIGHT.replace(frequency=f),)} for f in (0.2, 0.5, 1.0)},
    **{f"slosh 3 kg {f} Hz": {"oscillators": (TANK.replace(frequency=f, **STD),)} for f in (0.05, 0.2, 0.5)},
    "panels, slosh and all small errors": {
        "oscillators": (LIGHT, TANK.replace(**STD)),
        "tolerances": Tolerances(
            gyro_bias=1e-4, gyro_scale=1e-3, gyro_alignment=1e-3, wheel_inertia=1e-3, wheel_alignment=1e-3
        ),
    },
}


def kernels_of(case: str) -> str:
    """Size of the filter of a row: rows of one size share compiled kernels, so one process flies them all."""
    sheet = {name: value for name, value in FLIGHTS[case].items() if name != "coulomb"}
    satellite, filter = SATELLITES["microsat"].replace(**sheet), AdaptiveEKF().settings
    return f"{filter.other_states(satellite)} {filter.mode_count(satellite)} {satellite.sensors.lines}"


@pytest.mark.parametrize(
    "case", [pytest.param(case, marks=pytest.mark.xdist_group(kernels_of(case))) for case in FLIGHTS]
)
def test_the_filter_is_consistent_on_basilisks_truth(case):
    """Mean of 20 flights; each has 3 degrees of freedom, of which neighbours in time tell nearly the same."""
    settings = {"tolerances": Tolerances(), **FLIGHTS[case]}
    found = [flight(seed, **settings) for seed in range(20)]
    nees, relative_error = np.mean(found, axis=0)
    print(f"{case}: NEES {nees:.2f}, final error {relative_error:.4%}")
    assert 0.3 < nees < 2.0, found


PYRAMID = on_pyramid(SATELLITES["microsat"], (0.0, 10.0)).wheels
STEERED = {
    "exact": {},
    "full tensor": {"scenario": {"tilt_std": 0.15}},
    "friction 10 of 100 mN m": {"coulomb": 0.01},
    "commands three samples late": {"scenario": {"faults": {"torque_delay": (3, 3)}}},
    "panels, spared": {"oscillators": (LIGHT.replace(deflection_limit=float(np.radians(0.5))),)},
    "panels, reference with a slope": {"scenario": {"reference_slope": 0.3}, "oscillators": (LIGHT,)},
    "a wheel fails": {"fails": 40.0},
    "four wheels out of a band": {"wheels": PYRAMID},
}


def steered(
    seed: int,
    scenario: dict | None = None,
    coulomb: float = 0.0,
    oscillators: tuple[Oscillator, ...] = (),
    wheels: ReactionWheels = SATELLITES["microsat"].wheels,
    fails: float = np.inf,
) -> tuple[float, float, float, float]:
    """Shares of 120 s in which Basilisk's microsat is outside its rate limit and its panels beyond theirs; NEES.

    Last the share of the time after 30 s in which a wheel is in its avoided band. A pilot commands body rates,
    `shaped_square` where panels have a limit, else `rate_square`; inertia drawn as above. The first wheel fails at a
    time in s.
    """
    generator = np.random.default_rng([seed, 29])
    nominal = SATELLITES["microsat"].replace(oscillators=oscillators, wheels=wheels)
    world = Scenario().replace(**(scenario or {}))
    while True:
        turn = Rotation.from_rotvec(world.tilt_std * generator.normal(size=3)).as_matrix()
        inertia = np.diag(np.diag(nominal.inertia) * np.exp(0.15 * generator.normal(size=3)))
        if 2.0 * np.max(np.diag(inertia)) < np.trace(inertia):
            break
    inertia = turn @ inertia @ turn.T
    built = tuple(drawn(o, generator) for o in oscillators)
    rubbing, n = wheels.replace(friction=WheelFriction(coulomb=coulomb)), wheels.count
    theirs = Measured()
    theirs.begin(Satellite("body", inertia, rubbing, mass=95.0, oscillators=built), generator.uniform(-100.0, 100.0, n))
    limited = [o for o in built if o.deflection_limit is not None]
    policy = ShapedSquarePolicy() if limited else RateSquarePolicy(36.0, 3.5)
    pilot = Pilot(nominal, policy, scenario=world, control="rate")
    late = [np.zeros(n)] * world.faults.torque_delay[1]
    outside, beyond, nees, in_band = [], [], [], []
    for k in range(1200):
        rate, gyro, speed = theirs.readings()
        if k >= 300:
            in_band.append(np.abs(speed).min() < wheels.avoided_speed[1])
        gyro = gyro + nominal.gyro_noise_std * generator.normal(size=3)
        speed = speed + nominal.tachometer_noise_std * generator.normal(size=n)
        torque = np.zeros(n)
        if k > 0:  # Basilisk's IMU has no reading at time 0
            torque = (pilot.start if k == 1 else pilot.step)(k * PERIOD, gyro, speed)
        late.append(torque)
        outside.append(np.abs(rate).max() > nominal.rate_limit)
        beyond += [np.abs(theirs.state().deflection).max() > o.deflection_limit for o in limited]
        if k >= 300 and k % 10 == 0:
            found = pilot.estimate
            order = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))[: len(found.theta)]
            error = found.theta - [inertia[i, j] for i, j in order]
            nees.append(error @ np.linalg.solve(found.covariance, error) / len(error))
        works = np.arange(n) > 0 if k * PERIOD >= fails else np.ones(n)
        theirs.push_on(works * np.clip(late.pop(0) + 0.005 * generator.normal(size=n), -0.1, 0.1))
    return (
        float(np.mean(outside)), float(np.mean(beyond)) if beyond else 0.0, float(np.mean(nees)),
        float(np.mean(in_band)),
    )  # fmt: skip


@pytest.mark.parametrize("case", STEERED)
def test_rates_are_kept_on_basilisks_truth(case):
    """Mean of 8 flights: at most 1 % of the time outside the rate limit, beyond the panels', and in a band."""
    outside, beyond, nees, in_band = np.mean([steered(seed, **STEERED[case]) for seed in range(8)], axis=0)
    print(f"{case}: outside {outside:.3%}, beyond the deflection's limit {beyond:.3%}, NEES {nees:.2f}, "
          f"in the band {in_band:.3%}")  # fmt: skip
    assert outside <= 0.01
    assert in_band <= 0.01
    assert beyond <= 0.01
    assert 0.2 < nees < 2.5


@pytest.mark.parametrize("world", [{}, {"sensors": {"star_tracker": {}}, "tolerances": {"gyro_bias": 1e-4}}])
def test_an_episode_on_basilisks_truth_is_that_on_the_environments_own(world):
    """60 s with noise, disturbance and gravity gradient, at random torque: all that info tells."""
    flown = []
    for truth in (None, BasiliskTruth()):
        env = SatInertiaIDEnv("microsat", "static", world, truth=truth)
        generator = np.random.default_rng(0)
        env.reset(seed=0)
        infos = [env.step(generator.uniform(-0.2, 0.2, 3))[4] for _ in range(60)]
        flown.append(np.array([[info["relative_error"], info["nees"], info["outside"]] for info in infos]))
    ours, theirs = flown
    assert ours[-1, 0] < 1e-3
    np.testing.assert_allclose(ours, theirs, rtol=1e-4)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_rotation_pulls_basilisks_panels_as_far_as_is_observed(side):
    """Rates about the panels' own axis and the third bend them for as long as they stay."""
    panels = panel_pair(SATELLITES["microsat"], 0.1, 0, 2, frequency=0.1, damping=0.2, deflection_limit=0.01)
    quiet = {"torque_noise": 0.0, "inertia_std": 0.0, "disturbance_scale": 0.0, "solar_pressure": 0.0}
    satellite = SATELLITES["microsat"].replace(oscillators=[panels])
    env = SatInertiaIDEnv(satellite, "static", quiet, control="rate", observation="body", truth=BasiliskTruth())
    env.reset(seed=0)
    for _ in range(120):
        observation, _, _, _, info = env.step(np.array([0.8, 0.8 * side, 0.0], np.float32))
    seen = observation[env.layout["modes"]]
    x, y, _ = observation[env.layout["rate"]].astype(float)
    K = seen[MODE_PLACES["centrifugal"] :].astype(float)
    pulled = K[0] * x * x + K[1] * y * y + 2.0 * K[3] * x * y  # z hardly turns
    assert np.sign(pulled) == np.sign(seen[MODE_PLACES["deflection"]])
    of_limit = np.abs(info["deflection"]) / panels.deflection_limit
    np.testing.assert_allclose(of_limit, abs(pulled) / seen[MODE_PLACES["deflection_limit"]], rtol=0.05)


def test_panel_tour_spares_basilisks_panels():
    """Slow panels of cubesat, which full rates pull nearly to their limit; not as heavy and slow as expected."""
    panels = panel_pair(
        SATELLITES["cubesat"], 0.15, 0, 2, frequency=0.1, damping=0.005, deflection_limit=np.radians(0.5)
    )
    satellite = SATELLITES["cubesat"].replace(oscillators=[panels.replace(**STD)])
    cell = {"satellite": satellite, "inertia": "static", "seeds": seeds("validation", 6), "control": "rate"}
    own, theirs = (fly(find("panel_tour"), truth=truth, **cell).scores() for truth in (None, BasiliskTruth))
    assert own["cost"].mean() <= 0.01
    for name in ("cost", "mean_error", "final_error", "nees"):
        np.testing.assert_allclose(theirs[name], own[name], rtol=0.05, atol=1e-4)


@pytest.mark.parametrize(
    ("nominal", "times"), [(PANELS, 20.0), (TANK.replace(frequency=0.2), 2.0)], ids=["panels", "tank"]
)
def test_the_inertia_is_identified_from_a_log_of_basilisk(nominal, times):
    """300 s of slews, panels or tank off nominal; a rigid body's error is so many times as large."""
    generator, own = np.random.default_rng(7), nominal.replace(**TOLD)
    sheet = SATELLITES["microsat"].replace(gyro_noise_std=1e-5, oscillators=(own,))
    truth = sheet.replace(inertia=1.05 * sheet.inertia, oscillators=(drawn(own, generator),))
    theirs, seen = Measured(), []
    theirs.begin(truth, generator.uniform(-90.0, 90.0, 3))
    for torque in slews(truth, generator, 300.0):
        seen.append(theirs.readings()[1:])
        theirs.push_on(torque)
    gyro, speed = (np.array(rows)[1:] for rows in zip(*seen, strict=True))  # its IMU has no reading at time 0
    gyro += generator.normal([1e-3, -1e-3, 5e-4], sheet.gyro_noise_std, gyro.shape)
    speed += generator.normal(0.0, sheet.tachometer_noise_std, speed.shape)
    log = Log(time=PERIOD * np.arange(len(gyro)), rate=gyro, wheel_speed=speed)
    found, rigid = identify(log, sheet), identify(log, sheet.replace(oscillators=()))
    errors = tensor_errors(found, truth)
    largest, of_rigid = np.abs(errors).max(), np.abs(tensor_errors(rigid, truth)).max()
    print(f"largest error {largest:.1e} of the mean moment, {of_rigid:.1e} as a rigid body")
    assert largest < 3e-4
    assert of_rigid > times * largest
    std = np.sqrt(np.diag(found.covariance))
    assert (np.abs(errors) * np.diag(truth.inertia).mean() < 4.0 * std).all()
    (frequency,) = [p for p in found.parameters if p.name == "frequency of oscillator 1"]
    assert frequency.value == pytest.approx(truth.oscillators[0].frequency, rel=0.01)


def test_basilisk_in_the_loop():
    left = example("05_basilisk_in_the_loop.py")
    assert left["truncated"]
    assert left["info"]["relative_error"] < 1e-3
    assert left["error"] < 1e-3


def test_a_study_that_was_stopped_goes_on_with_the_cells_it_has(tmp_path, monkeypatch):
    monkeypatch.setattr("baselines.command.provenance.revision", lambda _: "a1")
    asked = study.BasiliskStudy(
        rows=("rigid",), policies=("sawtooth", "generalist"), episodes=2, output=tmp_path / "found.json"
    )
    whole, cells = study.cell, []

    def until_stopped(*place):
        cells.append(whole(*place) if not cells else None)
        if cells[-1] is None:
            raise KeyboardInterrupt
        return cells[-1]

    monkeypatch.setattr(study, "cell", until_stopped)
    with pytest.raises(KeyboardInterrupt, match="the same command goes on"):
        study.main(asked)
    (cell,) = json.loads(asked.output.read_text())["cells"]
    for score in ("final_error", "nees"):
        assert cell["basilisk"][score] == pytest.approx(cell["own"][score], rel=1e-3)
    monkeypatch.setattr(study, "cell", lambda _, row, policy: {"row": row, "policy": policy, "own": None})
    with pytest.raises(cli.UserError, match="was flown with episodes = 2: give another"):
        study.main(replace(asked, episodes=3))
    study.main(asked)
    kept, _ = json.loads(asked.output.read_text())["cells"]
    assert kept == cell


def example(name):
    return runpy.run_path(str(Path(__file__).parents[1] / "examples" / name), run_name="__main__")
