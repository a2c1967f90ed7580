"""Train an excitation policy in seconds, then fly it against scripted excitation.

From the checkout: PYTHONPATH=. python examples/02_train_your_own_policy.py
"""

import torch
from stable_baselines3 import PPO

from agents.rate_env import RateCommandVecEnv
from agents.settings import named
from agents.train import learned_policy
from baselines import make_baseline
from satid_gym.evaluation import benchmark_scenario, fly, seeds

torch.set_num_threads(1)  # the network is small: a second thread only takes cores from the environments

# The network commands body rates; the rate loop turns them into torque. Settings are those of the shipped policy,
# on fewer environments: that one had 4 million decisions for three satellites, this one 40 thousand for one.
settings = named("generalist")
env = RateCommandVecEnv(64, margin=settings.margin, satellite="microsat", reward=settings.reward)
env.seed(0)
model = PPO(
    "MlpPolicy",
    env,
    n_steps=50,
    batch_size=800,
    n_epochs=settings.epochs,
    gamma=settings.gamma,
    gae_lambda=settings.gae_lambda,
    learning_rate=1e-3,
    use_sde=True,
    sde_sample_freq=settings.hold,
    policy_kwargs={"net_arch": list(settings.hidden), "log_std_init": settings.log_std},
    seed=0,
    device="cpu",
)
model.learn(40_000)
mine = learned_policy(model, settings)
mine.name = "mine"

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
