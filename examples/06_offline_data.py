"""Fly the generalist into a Minari data set, clone it from the file alone, and fly both on seeds that neither saw.

From the checkout, with pip install ".[reach]": PYTHONPATH=. python examples/06_offline_data.py
"""

import os
import sys
import tempfile

import minari
import numpy as np
import torch

from agents.dataset.collection import Collection, collect
from agents.training.clocks import set_clocks
from satid_gym.evaluation import benchmark_scenario, fly, seeds
from satid_gym.gym_api import COSTS
from satid_gym.policies import find
from satid_gym.policies.learned import LearnedPolicy, Network
from satid_gym.satellite import BENCHMARK_SATELLITES

EPISODES, EPOCHS = (int(word) for word in sys.argv[1:3] or (100, 20))  # of each cell; over all decisions
torch.set_num_threads(1)
torch.manual_seed(0)

with tempfile.TemporaryDirectory() as folder:
    os.environ["MINARI_DATASETS_PATH"] = folder  # without it, Minari's own folder
    # as python -m agents.dataset --policies generalist --control rate --episodes 100
    (name,) = collect(Collection(policies=("generalist",), control="rate", episodes=EPISODES))
    data = minari.load_dataset(name)
    episodes = list(data.iterate_episodes())
    posed = data.recover_environment().unwrapped.problem
costs = {name: np.mean([episode.infos["costs"][name][1:].mean() for episode in episodes]) for name in COSTS}
told = ", ".join(f"{name} {cost:.2%}" for name, cost in costs.items())
print(f"{len(episodes)} episodes, {sum(map(len, episodes))} decisions, mean costs: {told}")

observations = torch.from_numpy(np.concatenate([episode.observations[:-1] for episode in episodes]))
actions = torch.from_numpy(np.concatenate([episode.actions for episode in episodes]))  # body rates, -1 to 1
model = torch.nn.Sequential(
    torch.nn.Linear(observations.shape[1], 256), torch.nn.Tanh(), torch.nn.Linear(256, 256), torch.nn.Tanh(),
    torch.nn.Linear(256, 3),
)  # fmt: skip
set_clocks(model[0], posed)  # first units that know when the episode is about to end
optimizer = torch.optim.Adam(model.parameters(), 3e-3)
batches = len(observations) // 512
decay = torch.optim.lr_scheduler.LinearLR(optimizer, 1.0, 0.01, EPOCHS * batches)
for _ in range(EPOCHS):
    for rows in torch.randperm(len(observations))[: 512 * batches].split(512):
        # most rates are at one limit or the other: which side, as a probability, weighted by how far it goes
        side, weight = (actions[rows] > 0.0).float(), actions[rows].abs()
        loss = torch.nn.functional.binary_cross_entropy_with_logits(model(observations[rows]), side, weight)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        decay.step()
with torch.no_grad():
    model[-1].weight *= 16.0  # and flown as the more probable one
    model[-1].bias *= 16.0
clone = LearnedPolicy("clone", Network.of_layers(model), "rate", margin=2.75, include_covariance=True)

world = {"inertia": "random", "scenario": benchmark_scenario(), "control": "rate", "seeds": seeds("validation", 64)}
errors = {}
for policy in (find("generalist"), clone):
    found = [fly(policy, satellite=s, **world).scores()["final_error"].mean() for s in BENCHMARK_SATELLITES]
    errors[policy.name] = np.mean(found)
    print(f"{policy.name:10s} final error {errors[policy.name]:.4%}: {', '.join(f'{e:.4%}' for e in found)}")
