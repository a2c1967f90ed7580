"""Basilisk, an independent simulator, in the place of the environment's own truth; pip install ".[basilisk]".

python examples/05_basilisk_in_the_loop.py
"""

import gymnasium
import numpy as np

import satid_gym
from satid_gym.basilisk import BasiliskTruth
from satid_gym.policies import find
from satid_gym.policy import missions, observation_settings
from satid_gym.truth import Episode

# The environment draws the episode, the noise and the faults, and judges; Basilisk moves body and wheels.
policy = find("generalist")
env = gymnasium.make("SatInertiaID-v0", inertia="static", truth=BasiliskTruth(), **observation_settings(policy))
policy.reset(missions(env.unwrapped.problem)[0], seeds=[0])
observation, info = env.reset(seed=0)
terminated = truncated = False
while not (terminated or truncated):
    observation, reward, terminated, truncated, info = env.step(policy(observation[None])[0])
print(f"environment on Basilisk: error {info['relative_error']:.4%}, NEES {info['nees']:.2f}")

# Without the environment: a pilot on readings of Basilisk's satellite, which is not the one that it was told of.
rng = np.random.default_rng(0)
nominal = satid_gym.SATELLITES["microsat"]
built = nominal.replace(inertia=[7.1, 5.4, 4.9])  # kg m^2
truth = BasiliskTruth()
state = truth.start(Episode(satellite=built, wheel_speed=np.array([100.0, -50.0, 20.0])))
pilot = satid_gym.Pilot(nominal, policy="generalist")
for sample in range(3000):  # ten a second
    gyro = state.rate + nominal.gyro_noise_std * rng.standard_normal(3)
    wheel_speed = state.wheel_speed + nominal.tachometer_noise_std * rng.standard_normal(3)
    torque = (pilot.step if sample else pilot.start)(0.1 * sample, gyro, wheel_speed)
    state = truth.advance(torque, disturbance=np.zeros(3), duration=0.1)
error = np.linalg.norm(pilot.estimate.inertia - built.inertia) / np.linalg.norm(built.inertia)
print(f"pilot on Basilisk: error {error:.4%}, J = {pilot.estimate.theta.round(3)} kg m^2")
