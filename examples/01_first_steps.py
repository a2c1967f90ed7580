"""First steps: fly one episode by hand, and read what the filter has learned.

python examples/01_first_steps.py
"""

import gymnasium
import numpy as np

import satid_gym  # registers SatInertiaID-v0

env = gymnasium.make("SatInertiaID-v0", satellite="cubesat", inertia="step")
observation, info = env.reset(seed=0)
print(f"action {env.action_space}, observation {env.observation_space}")
print(f"before the flight the inertia is wrong by {info['relative_error']:.1%}")

# An eighth of full torque on each axis, reversed every 6 s, the axes 4 s apart. Nobody watches the rates here: motor
# noise moves them outside the limit now and then. A policy that reads the observation does better.
for second in range(300):
    phase = second / 12.0 + np.arange(3) / 3.0
    action = 0.125 * np.where(phase % 1.0 < 0.5, 1.0, -1.0)
    observation, reward, terminated, truncated, info = env.step(action)
    if second % 60 == 59 or terminated:
        nats, outside = info["information_held"], info["outside"]
        print(f"{info['time']:5.0f} s: error {info['relative_error']:.2%}, {nats:.1f} nats held, {outside:.0%} outside")
    if terminated or truncated:
        break

names = env.unwrapped.layout
print("the policy sees rates", observation[names["rate"]], "and uncertainty", observation[names["uncertainty"]])
print("estimate:", np.diag(info["inertia_estimate"]).round(4), "truth:", np.diag(info["inertia_true"]).round(4))

# The truth alone, without noise or filter: momentum is conserved whatever the motors do.
motion = satid_gym.simulate(satid_gym.SATELLITES["cubesat"], 0.005 * np.ones((100, 3)), dt=0.1)
print(f"after 10 s of torque: rate {motion.omega[-1]} rad/s, momentum {np.linalg.norm(motion.momentum[-1]):.1e} N m s")
