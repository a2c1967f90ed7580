"""PPO of RL Zoo by its own command line, with the hyperparameters of `rl_zoo3.yml`.

PYTHONPATH=. python examples/trainers/ppo_rl_zoo3.py
"""

import sys
import tempfile
from pathlib import Path

from excitation import Learned, command, first_seed
from rl_zoo3.train import train as rl_zoo3_train
from stable_baselines3 import PPO


def train(steps, seed):
    """The policy after `steps` decisions."""
    with tempfile.TemporaryDirectory() as folder:
        words = f"--algo ppo --env Excitation-v0 --gym-packages excitation --n-timesteps {steps}"
        words += f" --seed {first_seed(seed)}"  # of the network too
        words += f" --eval-freq -1 --device cpu --verbose 0 --log-folder {folder}"
        words += f" --conf-file {Path(__file__).with_name('rl_zoo3.yml')}"
        sys.argv = ["rl_zoo3.train", *words.split()]
        rl_zoo3_train()
        model = PPO.load(next(Path(folder).rglob("Excitation-v0.zip")), device="cpu")
    return Learned(lambda observations: model.predict(observations, deterministic=True)[0])


if __name__ == "__main__":
    command(train, "RL Zoo")
