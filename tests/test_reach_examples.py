"""Examples that need Ray: they run, and what they leave can be flown."""

import runpy
from pathlib import Path

import pytest

ray = pytest.importorskip("ray")
pytestmark = pytest.mark.reach

from agents.training.ppo import PPOSettings
from satid_gym.policies import find


@pytest.fixture
def example(monkeypatch):
    """Run an example with arguments, and what it leaves."""
    folder = Path(__file__).parents[1] / "examples"
    arguments = []
    monkeypatch.setattr("sys.argv", arguments)

    def run(name):
        return runpy.run_path(str(folder / name), run_name="__main__")

    run.arguments = arguments
    yield run
    ray.shutdown()


def test_rllib_learns_stops_and_goes_on(example):
    example.arguments += ["rllib_ppo.py", "8"]
    left = example("rllib_ppo.py")
    assert left["returns"][1] > left["returns"][0]
    assert left["errors"]["rllib_ppo"] < 0.01, "rates of zero leave 1.4 %"


def test_trials_of_ray_tune_are_runs(example, tmp_path):
    folder = tmp_path / "tune"
    words = f"ray_tune.py --trials 2 --steps 6400 --evaluate-every 3200 --folder {folder}"
    example.arguments += words.split()
    results = example("ray_tune.py")["results"]
    assert len(results) == 2
    assert not results.errors
    for result in results:
        settings = PPOSettings.of_run(Path(result.path) / "run")
        assert {name: getattr(settings, name) for name in result.config} == result.config
        assert find(f"{Path(result.path) / 'run'}").control == "rate"
    first, second = (result.config["learning_rate"] for result in results)
    assert first != second
