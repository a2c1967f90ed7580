"""Truth and filter against Basilisk, an independent simulator (https://avslab.github.io/basilisk/).

A lane of its own: `make test-basilisk` installs Basilisk and runs it.
"""

from dataclasses import dataclass, field

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from satid_gym import (
    SATELLITES,
    Pilot,
    ReactionWheels,
    Satellite,
    SatInertiaIDEnv,
    Scenario,
    Sensors,
    Tolerances,
    simulate,
)
from satid_gym.core import kernels
from satid_gym.estimators import AdaptiveEKF
from satid_gym.friction import WheelFriction
from satid_gym.oscillators import Oscillator, Panel
from satid_gym.policies.rate_square import RateSquarePolicy
from satid_gym.policies.shaped_square import ShapedSquarePolicy
from satid_gym.scenario import prior_of
from tests.flexible import BOOM, PANELS, TANK

pytestmark = pytest.mark.basilisk

PERIOD = 0.1  # s, of a sample


@dataclass
class Basilisk:
    """A body with balanced wheels, panels, slosh masses and an IMU in Basilisk, sampled at 10 Hz.

    `inertia` includes panels and slosh masses at rest, as that of a `Satellite` does.

    Its errors of gyro and wheels are Basilisk's own: scale, then misalignment by a rotation of the platform, then bias.
    """

    inertia: np.ndarray
    axes: np.ndarray
    wheel_inertia: np.ndarray
    wheel_speed: np.ndarray
    rate: np.ndarray = field(default_factory=lambda: np.zeros(3))
    gyro_scale: np.ndarray = field(default_factory=lambda: np.ones(3))
    gyro_rotation: np.ndarray = field(default_factory=lambda: np.zeros(3))
    gyro_bias: np.ndarray = field(default_factory=lambda: np.zeros(3))
    oscillators: tuple[Oscillator, ...] = ()
    mass: float = 100.0
    friction: WheelFriction = field(default_factory=WheelFriction)
    step: float = 0.02  # s, of its Runge-Kutta method
    records: bool = False  # whether `turned` is asked for, which takes time

    def __post_init__(self) -> None:
        simulation = pytest.importorskip("Basilisk.simulation.spacecraft")
        from Basilisk.architecture import messaging
        from Basilisk.simulation import imuSensor, reactionWheelStateEffector
        from Basilisk.utilities import SimulationBaseClass, macros, simIncludeRW

        self.nanoseconds = macros.sec2nano
        self.sim = SimulationBaseClass.SimBaseClass()
        process = self.sim.CreateNewProcess("process")
        process.addTask(self.sim.CreateNewTask("dynamics", macros.sec2nano(self.step)))
        process.addTask(self.sim.CreateNewTask("sensors", macros.sec2nano(PERIOD)))
        self.body = simulation.Spacecraft()
        hub = self.mass - sum(o.count * o.mass for o in self.oscillators)
        offset = -sum((o.mass * o.place for o in self.oscillators if not o.mirrored), np.zeros(3)) / hub
        own = self.inertia - sum((o.inertia_at_rest for o in self.oscillators), np.zeros((3, 3)))
        own = own - hub * (offset @ offset * np.eye(3) - np.outer(offset, offset))
        self.body.hub.mHub, self.body.hub.r_BcB_B = hub, offset[:, None].tolist()
        self.body.hub.IHubPntBc_B = own.tolist()
        self.body.hub.omega_BN_BInit = [[float(w)] for w in self.rate]
        factory = simIncludeRW.rwFactory()
        for axis, inertia, speed in zip(self.axes.T, self.wheel_inertia, self.wheel_speed, strict=True):
            factory.create(
                "custom",
                axis.tolist(),
                Js=float(inertia),
                Omega=float(speed) * 60.0 / (2.0 * np.pi),
                Omega_max=1e6,
                u_max=1e3,
                useRWfriction=self.friction.acts,
                fCoulomb=self.friction.coulomb,
                fStatic=self.friction.breakaway,
                cViscous=self.friction.viscous,
                betaStatic=self.friction.stribeck_speed,
                RWModel=messaging.BalancedWheels,
            )
        self.wheels = reactionWheelStateEffector.ReactionWheelStateEffector()
        factory.addToSpacecraft("wheels", self.wheels, self.body)
        self.torque = messaging.ArrayMotorTorqueMsgPayload()
        self.torque_message = messaging.ArrayMotorTorqueMsg().write(self.torque)
        self.wheels.rwMotorCmdInMsg.subscribeTo(self.torque_message)
        self.imu = imuSensor.ImuSensor()
        self.imu.setBodyToPlatformDCM(*(float(angle) for angle in self.gyro_rotation[::-1]))  # yaw, pitch, roll
        self.imu.senRotBias = self.gyro_bias.tolist()
        self.imu.gyroScale, self.imu.accelScale = self.gyro_scale.tolist(), [1.0, 1.0, 1.0]
        self.imu.scStateInMsg.subscribeTo(self.body.scStateOutMsg)
        self.moving = [model for o in self.oscillators for model in models_of(o)]
        for model in self.moving:
            self.body.addStateEffector(model)
        self.sim.AddModelToTask("dynamics", self.wheels, 3)
        self.sim.AddModelToTask("dynamics", self.body, 2)
        for model in self.moving:
            self.sim.AddModelToTask("dynamics", model)
        self.sim.AddModelToTask("sensors", self.imu, 1)
        messages = (self.body.scStateOutMsg, self.wheels.rwSpeedOutMsg) if self.records else ()
        self.paths = tuple(message.recorder() for message in messages)
        for path in self.paths:
            self.sim.AddModelToTask("dynamics", path)
        self.sim.InitializeSimulation()
        self.sim.ConfigureStopTime(0)
        self.sim.ExecuteSimulation()
        self.samples = 0

    def readings(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """True rate (3,), gyro (3,) without noise and wheel speeds (n,), rad/s."""
        speed = np.array(self.wheels.rwSpeedOutMsg.read().wheelSpeeds)[: len(self.wheel_inertia)]
        rate = np.array(self.body.scStateOutMsg.read().omega_BN_B)
        return rate, np.array(self.imu.sensorOutMsg.read().AngVelPlatform), speed

    def turned(self) -> tuple[np.ndarray, np.ndarray]:
        """Angles that the body (3,) and the wheels (n,) have turned through in the last sample, rad."""
        start = np.array(self.start)
        body, wheels = self.paths
        path = np.hstack([body.omega_BN_B, np.array(wheels.wheelSpeeds)[:, : len(self.wheel_inertia)]])
        path = np.vstack([start, path])
        angle = CubicSpline(np.linspace(0.0, PERIOD, len(path)), path).integrate(0.0, PERIOD)
        return angle[:3], angle[3:]

    def advance(self, torque: np.ndarray) -> None:
        """A sample period of constant motor torque (n,), N m."""
        self.torque.motorTorque = [*torque.tolist(), *[0.0] * (36 - len(torque))]
        self.torque_message.write(self.torque, self.sim.TotalSim.CurrentNanos)
        self.samples += 1
        if self.records:
            rate, _, speed = self.readings()
            self.start = [*rate, *speed]
        for path in self.paths:
            path.clear()
        self.sim.ConfigureStopTime(self.nanoseconds(self.samples * PERIOD))
        self.sim.ExecuteSimulation()

    def deflection(self) -> np.ndarray:
        """Angles of the panels (c,), rad."""
        return np.array([model.hingedRigidBodyOutMsg.read().theta for model in self.moving])


def models_of(oscillator: Oscillator) -> list:
    """Basilisk's models of an oscillator, two of a mirrored pair; a panel's arm must be across its axis."""
    from Basilisk.simulation import hingedRigidBodyStateEffector, linearSpringMassDamper

    o, rate, found = oscillator, 2.0 * np.pi * oscillator.frequency, []
    for side in (1.0, -1.0)[: o.count]:
        if isinstance(o, Panel):
            model = hingedRigidBodyStateEffector.HingedRigidBodyStateEffector()
            model.mass, model.d = o.mass, float(np.linalg.norm(o.arm))
            first = -side * o.arm / model.d  # the centre of mass lies at -d s1, the hinge turns about s2
            frame = np.array([first, o.axis, np.cross(first, o.axis)])
            model.dcm_HB, model.IPntS_S = frame.tolist(), (frame @ o.inertia @ frame.T).tolist()
            model.r_HB_B = (side * o.hinge)[:, None].tolist()
            model.thetaInit = model.thetaDotInit = 0.0
        else:
            model = linearSpringMassDamper.LinearSpringMassDamper()
            model.massInit, model.r_PB_B = o.mass, (side * o.position)[:, None].tolist()
            model.pHat_B = (side * o.direction)[:, None].tolist()
            model.rhoInit = model.rhoDotInit = 0.0
        model.k, model.c = o.inertance * rate**2, 2.0 * o.damping * rate * o.inertance
        found.append(model)
    return found


def test_four_wheels_and_a_full_tensor_move_as_in_basilisk():
    """300 s of motor torque that changes every 2.5 s."""
    pytest.importorskip("Basilisk")
    c, s = np.cos(0.6), np.sin(0.6)
    axes = np.array([[c, 0.0, -c, 0.0], [0.0, c, 0.0, -c], [s, s, s, s]])
    wheel_inertia = np.array([2e-3, 2.1e-3, 1.9e-3, 2e-3])
    inertia = np.array([[6.5, 0.2, -0.1], [0.2, 6.0, 0.3], [-0.1, 0.3, 4.5]])
    rate, speed = np.array([0.01, -0.02, 0.015]), np.array([100.0, -50.0, 80.0, 20.0])
    pushes = np.random.default_rng(0).uniform(-0.05, 0.05, (60, 1, 4))
    torque = np.repeat(np.concatenate([pushes, -pushes], axis=1).reshape(120, 4), 25, axis=0)
    theirs = Basilisk(inertia, axes, wheel_inertia, speed, rate, step=0.01)
    seen = []
    for row in torque:
        seen.append(theirs.readings())
        theirs.advance(row)
    wheels = ReactionWheels(axes=axes, inertia=wheel_inertia, max_torque=1.0, max_speed=1e5)
    ours = simulate(Satellite("body", inertia, wheels), torque, PERIOD, omega0=rate, wheel_speed0=speed)
    rates, _, speeds = (np.array(values) for values in zip(*seen, strict=True))
    assert np.ptp(rates) > 0.05
    np.testing.assert_allclose(ours.omega[:-1], rates, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(ours.wheel_speed[:-1], speeds, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("oscillators", [(PANELS,), (TANK,), (PANELS, BOOM, TANK)], ids=["panels", "slosh", "all"])
def test_panels_and_slosh_move_as_in_basilisk(oscillators):
    """300 s of motor torque that changes every 2.5 s, deflections of several degrees; three wheels."""
    pytest.importorskip("Basilisk")
    inertia = np.array([[6.5, 0.2, -0.1], [0.2, 6.0, 0.3], [-0.1, 0.3, 4.5]])
    rate, speed, rotors = np.array([0.01, -0.02, 0.015]), np.array([100.0, -50.0, 80.0]), np.full(3, 2e-3)
    pushes = np.random.default_rng(0).uniform(-0.1, 0.1, (60, 1, 3))
    torque = np.repeat(np.concatenate([pushes, -pushes], axis=1).reshape(120, 3), 25, axis=0)
    theirs = Basilisk(inertia, np.eye(3), rotors, speed, rate, oscillators=oscillators, mass=95.0, step=0.005)
    seen, bent = [], []
    for row in torque:
        seen.append(theirs.readings()[0])
        bent.append(theirs.deflection() if oscillators == (PANELS,) else np.zeros(2))
        theirs.advance(row)
    wheels = ReactionWheels(inertia=rotors, max_torque=1.0, max_speed=1e5)
    body = Satellite("body", inertia, wheels, mass=95.0, oscillators=oscillators)
    ours = simulate(body, torque, PERIOD, omega0=rate, wheel_speed0=speed)
    np.testing.assert_allclose(ours.omega[:-1], seen, rtol=0.0, atol=1e-8)
    if oscillators == (PANELS,):
        assert np.abs(bent).max() > 0.02
        np.testing.assert_allclose(ours.deflection[:-1], bent, rtol=0.0, atol=1e-6)


def test_wheels_that_rub_move_as_in_basilisk():
    """300 s: from rest through the stiction, then up and down again under torque that changes every 2.5 s.

    Basilisk's stiction acts on a wheel that leaves rest; one that slows down again has Coulomb's friction alone, so the
    wheels do not come back below some times the speed at which stiction has gone.
    """
    pytest.importorskip("Basilisk")
    friction = WheelFriction(coulomb=4e-3, static=6e-3, viscous=1.6e-5, stribeck_speed=6.0)
    axes, wheel_inertia = np.eye(3), np.array([2e-3, 2.1e-3, 1.9e-3])
    inertia = np.array([[6.5, 0.2, -0.1], [0.2, 6.0, 0.3], [-0.1, 0.3, 4.5]])
    pushes = np.random.default_rng(0).uniform(0.0, 0.05, (59, 1, 3))
    changes = np.concatenate([np.full((2, 3), 0.07), np.stack([pushes, -pushes], axis=1).reshape(118, 3) + 7e-3])
    torque = np.repeat(changes, 25, axis=0)
    theirs = Basilisk(inertia, axes, wheel_inertia, np.zeros(3), friction=friction, step=0.002)
    seen = []
    for row in torque:
        seen.append(theirs.readings())
        theirs.advance(row)
    wheels = ReactionWheels(axes=axes, inertia=wheel_inertia, max_torque=1.0, max_speed=1e5, friction=friction)
    ours = simulate(Satellite("body", inertia, wheels), torque, PERIOD)
    rates, _, speeds = (np.array(values) for values in zip(*seen, strict=True))
    assert np.ptp(rates) > 0.05
    assert speeds[50:].min() > 54.0
    print(f"rates agree to {np.abs(ours.omega[:-1] - rates).max():.1e} rad/s")
    np.testing.assert_allclose(ours.omega[:-1], rates, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(ours.wheel_speed[:-1], speeds, rtol=0.0, atol=1e-4)


class Encoder:
    """Basilisk's encoder for so many wheels: pulses of an angle, and what is left over goes into the next count.

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
    pytest.importorskip("Basilisk")
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
    env = SatInertiaIDEnv("microsat", "static", quiet)
    env.reset(seed=0)
    plant, generator = env.fleet.rows.plants[0], np.random.default_rng(0)
    nominal = plant["inertia"], plant["axes"], plant["wheel_inertia"], plant["wheel_speed"], plant["rate"]
    theirs = Basilisk(*nominal, records=True)
    encoder, pulse = Encoder(24, 3), 2.0 * np.pi / 24.0
    ours, angles, bent, counts = [], [], [], np.zeros((2, 3))
    for k in range(200):
        if k % 5 == 0:
            env.fleet.work["torque"][0] = torque = generator.uniform(-0.1, 0.1, 3)
        kernels.sample(env.fleet.rows, env.fleet.work)
        theirs.advance(torque)
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
    theirs = Basilisk(
        inertia,
        axes / np.linalg.norm(axes, axis=0),
        wheels.inertia * (1.0 + t.wheel_inertia * generator.normal(size=3)),
        generator.uniform(-100.0, 100.0, 3),
        gyro_scale=1.0 + t.gyro_scale * generator.normal(size=3),
        gyro_rotation=t.gyro_alignment * generator.normal(size=3),
        gyro_bias=t.gyro_bias * generator.normal(size=3),
        friction=WheelFriction(coulomb=coulomb),
        oscillators=tuple(drawn(o, generator) for o in oscillators),
        mass=95.0,
        records=sensors is not None,
    )
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
        theirs.advance(np.clip(push + 0.005 * generator.normal(size=3), -0.1, 0.1))
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
    pytest.importorskip("Basilisk")
    settings = {"tolerances": Tolerances(), **FLIGHTS[case]}
    found = [flight(seed, **settings) for seed in range(20)]
    nees, relative_error = np.mean(found, axis=0)
    print(f"{case}: NEES {nees:.2f}, final error {relative_error:.4%}")
    assert 0.3 < nees < 2.0, found


STEERED = {
    "exact": {},
    "full tensor": {"scenario": {"tilt_std": 0.15}},
    "friction 10 of 100 mN m": {"coulomb": 0.01},
    "commands three samples late": {"scenario": {"faults": {"torque_delay": (3, 3)}}},
    "panels, spared": {"oscillators": (LIGHT.replace(deflection_limit=float(np.radians(0.5))),)},
}


def steered(
    seed: int, scenario: dict | None = None, coulomb: float = 0.0, oscillators: tuple[Oscillator, ...] = ()
) -> tuple[float, float, float]:
    """Shares of 120 s in which Basilisk's microsat is outside its rate limit and its panels beyond theirs; NEES.

    A pilot commands body rates, `shaped_square` where there are panels, else `rate_square`; inertia drawn as above.
    """
    generator, nominal = np.random.default_rng([seed, 29]), SATELLITES["microsat"].replace(oscillators=oscillators)
    world = Scenario().replace(**(scenario or {}))
    while True:
        turn = Rotation.from_rotvec(world.tilt_std * generator.normal(size=3)).as_matrix()
        inertia = np.diag(np.diag(nominal.inertia) * np.exp(0.15 * generator.normal(size=3)))
        if 2.0 * np.max(np.diag(inertia)) < np.trace(inertia):
            break
    inertia = turn @ inertia @ turn.T
    built = tuple(drawn(o, generator) for o in oscillators)
    theirs = Basilisk(
        inertia,
        nominal.wheels.axes,
        nominal.wheels.inertia,
        generator.uniform(-100.0, 100.0, 3),
        friction=WheelFriction(coulomb=coulomb),
        oscillators=built,
        mass=95.0,
    )
    policy = ShapedSquarePolicy() if oscillators else RateSquarePolicy(36.0, 3.5)
    pilot = Pilot(nominal, policy, scenario=world, control="rate")
    late = [np.zeros(3)] * world.faults.torque_delay[1]
    outside, beyond, nees = [], [], []
    for k in range(1200):
        rate, gyro, speed = theirs.readings()
        gyro = gyro + nominal.gyro_noise_std * generator.normal(size=3)
        speed = speed + nominal.tachometer_noise_std * generator.normal(size=3)
        torque = np.zeros(3)
        if k > 0:  # Basilisk's IMU has no reading at time 0
            torque = (pilot.start if k == 1 else pilot.step)(k * PERIOD, gyro, speed)
        late.append(torque)
        outside.append(np.abs(rate).max() > nominal.rate_limit)
        beyond += [np.abs(theirs.deflection()).max() > o.deflection_limit for o in built]
        if k >= 300 and k % 10 == 0:
            found = pilot.estimate
            order = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))[: len(found.theta)]
            error = found.theta - [inertia[i, j] for i, j in order]
            nees.append(error @ np.linalg.solve(found.covariance, error) / len(error))
        theirs.advance(np.clip(late.pop(0) + 0.005 * generator.normal(size=3), -0.1, 0.1))
    return float(np.mean(outside)), float(np.mean(beyond)) if beyond else 0.0, float(np.mean(nees))


@pytest.mark.parametrize("case", STEERED)
def test_rates_are_kept_on_basilisks_truth(case):
    """Mean of 8 flights: at most 1 % of the time outside the rate limit, and beyond the panels'."""
    pytest.importorskip("Basilisk")
    outside, beyond, nees = np.mean([steered(seed, **STEERED[case]) for seed in range(8)], axis=0)
    print(f"{case}: outside {outside:.3%}, beyond the deflection's limit {beyond:.3%}, NEES {nees:.2f}")
    assert outside <= 0.01
    assert beyond <= 0.01
    assert 0.2 < nees < 2.5
