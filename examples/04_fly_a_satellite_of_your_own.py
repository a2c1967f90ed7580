"""A control loop outside the environment: your own simulation in place of the satellite.

python examples/04_fly_a_satellite_of_your_own.py
"""

import numpy as np

from satid_gym import SATELLITES, Pilot, simulate

rng = np.random.default_rng(0)
nominal = SATELLITES["microsat"]
truth = nominal.replace(inertia=[7.1, 5.4, 4.9])  # kg m^2; the pilot is told of the nominal satellite alone
pilot = Pilot(nominal, policy="generalist")

rate, speed = np.array([1e-3, -1e-3, 5e-4]), np.zeros(3)  # rad/s


def readings(lost=False):
    """What gyro and tachometers say; a lost reading is None."""
    gyro = rate + nominal.gyro_noise_std * rng.standard_normal(3)
    wheel_speed = speed + nominal.tachometer_noise_std * rng.standard_normal(3)
    return None if lost else gyro, wheel_speed


torque = pilot.start(0.0, *readings())
for sample in range(1, 3001):  # ten a second
    motion = simulate(truth, torque[None], 0.1, omega0=rate, wheel_speed0=speed)
    rate, speed = motion.omega[-1], motion.wheel_speed[-1]
    torque = pilot.step(0.1 * sample, *readings(lost=rng.random() < 0.01))
    if sample % 600 == 0:
        believed = pilot.estimate
        print(f"{sample // 10:3d} s: J = {believed.theta.round(3)} +- {believed.std.round(4)} kg m^2")

error = np.linalg.norm(pilot.estimate.inertia - truth.inertia) / np.linalg.norm(truth.inertia)
print(f"error {error:.3%}; {pilot.status.counts['missing']} readings were missing; the flight is {pilot.status.state}")
