"""Truth and filter against Basilisk, an independent simulator (https://avslab.github.io/basilisk/).

A lane of its own: `make test-basilisk` installs Basilisk and runs it.
"""

from dataclasses import dataclass, field

import numpy as np
import pytest

from satid_gym import SATELLITES, ReactionWheels, Satellite, Scenario, Tolerances, simulate
from satid_gym.estimators import AdaptiveEKF
from satid_gym.scenario import prior_of

pytestmark = pytest.mark.basilisk

PERIOD = 0.1  # s, of a sample


@dataclass
class Basilisk:
    """A rigid body with balanced wheels and an IMU in Basilisk, sampled at 10 Hz.

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
    step: float = 0.02  # s, of its Runge-Kutta method

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
        self.body.hub.mHub, self.body.hub.r_BcB_B = 100.0, [[0.0], [0.0], [0.0]]
        self.body.hub.IHubPntBc_B = self.inertia.tolist()
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
                useRWfriction=False,
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
        self.sim.AddModelToTask("dynamics", self.wheels, 3)
        self.sim.AddModelToTask("dynamics", self.body, 2)
        self.sim.AddModelToTask("sensors", self.imu, 1)
        self.sim.InitializeSimulation()
        self.sim.ConfigureStopTime(0)
        self.sim.ExecuteSimulation()
        self.samples = 0

    def readings(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """True rate (3,), gyro (3,) without noise and wheel speeds (n,), rad/s."""
        speed = np.array(self.wheels.rwSpeedOutMsg.read().wheelSpeeds)[: len(self.wheel_inertia)]
        rate = np.array(self.body.scStateOutMsg.read().omega_BN_B)
        return rate, np.array(self.imu.sensorOutMsg.read().AngVelPlatform), speed

    def advance(self, torque: np.ndarray) -> None:
        """A sample period of constant motor torque (n,), N m."""
        self.torque.motorTorque = [*torque.tolist(), *[0.0] * (36 - len(torque))]
        self.torque_message.write(self.torque, self.sim.TotalSim.CurrentNanos)
        self.samples += 1
        self.sim.ConfigureStopTime(self.nanoseconds(self.samples * PERIOD))
        self.sim.ExecuteSimulation()


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


def flight(tolerances: Tolerances, seed: int) -> tuple[float, float]:
    """Mean NEES after 30 s and final relative error of the default filter on 120 s of Basilisk's truth.

    Microsat, inertia drawn as scenario "default" does, square waves of rate by its three wheels; the sensors' noise is
    drawn here.
    """
    generator, nominal = np.random.default_rng([seed, 17]), SATELLITES["microsat"]
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
    )
    prior = prior_of(nominal, Scenario(tolerances=tolerances, gravity_gradient=False, disturbance_scale=0.1))
    estimator, nees, error = AdaptiveEKF(), [], np.nan
    signs = np.array([1.0, -1.0, 1.0])
    for k in range(1200):
        _, gyro, speed = theirs.readings()
        gyro = gyro + prior.gyro_noise_std * generator.normal(size=3)
        speed = speed + prior.tachometer_noise_std * generator.normal(size=3)
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


ERRORS = {
    "exact": Tolerances(),
    "gyro bias": Tolerances(gyro_bias=1e-3),
    "gyro scale": Tolerances(gyro_scale=1e-2),
    "gyro alignment": Tolerances(gyro_alignment=3e-3),
    "rotor inertia": Tolerances(wheel_inertia=1e-2),
    "wheel axes": Tolerances(wheel_alignment=5e-3),
    "all": Tolerances(gyro_bias=1e-4, gyro_scale=1e-3, gyro_alignment=1e-3, wheel_inertia=1e-3, wheel_alignment=1e-3),
}


@pytest.mark.parametrize("error", ERRORS)
def test_the_filter_is_consistent_on_basilisks_truth(error):
    """Mean of 20 flights; each has 3 degrees of freedom, of which neighbours in time tell nearly the same."""
    pytest.importorskip("Basilisk")
    found = [flight(ERRORS[error], seed) for seed in range(20)]
    nees, relative_error = np.mean(found, axis=0)
    print(f"{error}: NEES {nees:.2f}, final error {relative_error:.4%}")
    assert 0.3 < nees < 2.0, found
