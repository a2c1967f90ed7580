"""Hyperparameters of PPO by Ray Tune: each trial is a run as of `python -m agents.train`, with folder and checkpoint.

Trials are judged on validation seeds by the merit that chooses a run's best policy, and poor ones are stopped early.
The trial of a worker that is lost goes on from the run's checkpoint.

From the checkout, with pip install ".[reach]": PYTHONPATH=. python examples/ray_tune.py
"""

import argparse
from pathlib import Path

import ray
from ray import tune

from agents.training import ppo
from agents.training.ppo import PPOSettings
from agents.training.run import Run, merit

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("--address", default="local", help="of the cluster, as of --ray: auto, HOST:PORT or local")
parser.add_argument("--trials", type=int, default=8)
parser.add_argument("--steps", type=int, default=400_000, help="decisions of a trial that is not stopped")
parser.add_argument("--evaluate-every", type=int, default=50_000, help="decisions between a trial's reports")
parser.add_argument("--folder", type=Path, default=Path("runs/tune"))
options = parser.parse_args()
every = {"satellite": "microsat", "steps": options.steps, "evaluate_every": options.evaluate_every}
searched = {
    "learning_rate": tune.loguniform(3e-4, 5e-3),
    "gamma": tune.choice([0.8, 0.9, 0.95]),
    "gae_lambda": tune.choice([0.6, 0.8, 0.95]),
    "log_std": tune.uniform(-1.0, 1.0),
}


class ReportedRun(Run):
    """Run that tells Ray Tune of each evaluation."""

    def keep(self, policy):
        """Save an evaluated policy, and report its merit; lower is better."""
        super().keep(policy)
        tune.report({"merit": merit(policy.details["validation"]), "decisions": self.curve[-1]["steps"]})


def trial(config):
    """A run with its settings, from the start or from where it was stopped."""
    folder = Path(tune.get_context().get_trial_dir()) / "run"
    settings = PPOSettings(**every, **config)
    resume = (folder / "run.json").exists()
    ppo.train(ReportedRun(settings, folder, resume=resume, module="agents.train"))


ray.init(address=options.address, include_dashboard=False if options.address == "local" else None, log_to_driver=False)
tuner = tune.Tuner(
    tune.with_resources(trial, {"cpu": 1}),
    param_space=searched,
    tune_config=tune.TuneConfig(
        metric="merit",
        mode="min",
        num_samples=options.trials,
        scheduler=tune.schedulers.ASHAScheduler(
            time_attr="decisions", max_t=options.steps, grace_period=2 * options.evaluate_every, reduction_factor=2
        ),
    ),
    run_config=tune.RunConfig(
        name=options.folder.name,
        storage_path=str(options.folder.resolve().parent),
        failure_config=tune.FailureConfig(max_failures=3),
        verbose=0,
    ),
)
results = tuner.fit()
ray.shutdown()
for result in sorted(results, key=lambda result: result.metrics["merit"]):
    chosen = ", ".join(f"{name} {value:.3g}" for name, value in result.config.items())
    print(f"merit {result.metrics['merit']:.5f} after {result.metrics['decisions']} decisions: {chosen}")
best = results.get_best_result()
print(f"policy: {Path(best.path) / 'run' / 'policy'}.safetensors")
