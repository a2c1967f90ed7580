"""Train an excitation policy in seconds, then fly it against scripted excitation.

From the checkout: PYTHONPATH=. python examples/02_train_your_own_policy.py
"""

import torch
from stable_baselines3 import PPO

from agents.training.ppo import PPOSettings, learned_policy
from satid_gym.evaluation import benchmark_scenario, fly, seeds
from satid_gym.policies import make_baseline
from satid_gym.sb3 import RateCommandVecEnv

torch.set_num_threads(1)  # the network is small: a second thread only takes cores from the environments

# The network commands body rates; the rate loop turns them into torque. What is paid for is information held.
settings = PPOSettings(name="mine", satellite="microsat", margin=2.6)
env = RateCommandVecEnv(
    64,
    margin=settings.margin,
    stagger=True,  # so that a rollout holds every part of an episode
    satellite=settings.satellite,
    reward=settings.reward,
    include_covariance=settings.include_covariance,
)
env.seed(0)
model = PPO(
    "MlpPolicy",
    env,
    n_steps=50,
    batch_size=800,
    n_epochs=5,
    gamma=0.9,
    learning_rate=2e-3,
    use_sde=True,  # exploration that holds its direction, here for 15 s: a random square wave of body rates
    sde_sample_freq=15,
    policy_kwargs={"net_arch": [64, 64], "log_std_init": 0.5},
    seed=0,
    device="cpu",
)
model.learn(80_000)
mine = learned_policy(model, settings)

# The same 16 episodes for everybody, on seeds that training never saw.
cell = {
    "satellite": "microsat",
    "inertia": "random",
    "seeds": seeds("validation", 16),
    "scenario": benchmark_scenario(),
}
rivals = [make_baseline(name, "microsat") for name in ("sine", "staggered_square", "rate_square")]
errors = {}
for policy in (mine, *rivals):
    scores = fly(policy, **cell).scores()
    errors[policy.name] = scores["final_error"].mean()
    print(f"{policy.name:17s} final error {errors[policy.name]:.3%}, outside {scores['outside_fraction'].mean():.1%}")
