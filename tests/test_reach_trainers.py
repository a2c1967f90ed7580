"""Other people's trainers: each learns to excite, with the environments in the mode of autoreset that it expects."""

import importlib
from pathlib import Path

import numpy as np
import pytest

pytestmark = pytest.mark.reach
for library in ("sb3_contrib", "skrl", "tianshou", "torchrl", "rl_zoo3"):
    pytest.importorskip(library)
torch = pytest.importorskip("torch")

FOLDER = Path(__file__).parents[1] / "examples" / "trainers"
TRAINERS = [path.stem for path in sorted(FOLDER.glob("ppo_*.py"))]
DECISIONS = {"ppo_recurrent": 192_000, "ppo_rl_zoo3": 192_000}  # slower learners than the others, which have 96 000


@pytest.fixture(autouse=True)
def _trainers_are_importable(monkeypatch):
    monkeypatch.syspath_prepend(str(FOLDER))
    torch.set_num_threads(1)


@pytest.fixture
def excitation():
    return importlib.import_module("excitation")


@pytest.mark.parametrize("name", TRAINERS)
@pytest.mark.filterwarnings("ignore::FutureWarning")
def test_a_trainer_learns_to_excite_within_the_envelope(name, excitation, monkeypatch):
    monkeypatch.setattr("sys.argv", [name])
    untrained = excitation.scores(excitation.Learned(lambda observations: np.zeros((len(observations), 3))))
    learned = excitation.scores(importlib.import_module(name).train(DECISIONS.get(name, 96_000), 0))
    assert learned["final_error"] < 0.3 * untrained["final_error"]
    assert learned["outside_fraction"] < 0.01


def test_the_horizon_is_the_end_of_the_task(excitation):
    env = excitation.Excitation("SameStep", 3, 4)
    env.reset()
    ends = np.zeros(4, int)
    for _ in range(300):
        observations, _, terminations, truncations, infos = env.step(np.zeros((4, 3)))
        ends += terminations
        assert not truncations.any()
        for i in np.flatnonzero(terminations):  # what follows is the next episode's beginning
            left = env.unwrapped.problem.layout["time_left"]
            assert observations[i, left] == 1.0
            assert infos["final_obs"][i][left] == 0.0
    assert (ends == [1, 1, 1, 1]).all()


def test_the_first_reset_has_the_seed_of_the_trainer(excitation):
    first, again, other = (excitation.Excitation("SameStep", seed, 4) for seed in (3, 3, 4))
    begun = first.reset(seed=8)[0]
    assert (again.reset()[0] == begun).all()
    assert (other.reset()[0] != begun).any()
    assert (again.reset()[0] != begun).any()


def test_what_is_commanded_stays_below_the_limit(excitation):
    assert excitation.commanded([[2.0, -3.0, 0.5]]).tolist() == [[0.97, -0.97, 0.485]]


def test_torchrl_refuses_the_default_autoreset_and_resets_by_itself(excitation):
    from torchrl.envs import GymWrapper

    with pytest.raises(RuntimeError, match="SAME_STEP or DISABLED"):
        GymWrapper(excitation.Excitation("NextStep", 0, 2))
    env = GymWrapper(excitation.Excitation("Disabled", 0, 3))
    rollout = env.rollout(301, lambda observations: torch.zeros(3, 3), break_when_any_done=False)
    left = env._env.unwrapped.problem.layout["time_left"]
    ended = rollout["next", "terminated"][..., 0]
    assert ended.sum(1).tolist() == [1, 1, 1]
    assert (rollout["next", "observation"][ended][:, left] == 0.0).all()
    assert (rollout["observation"][:, 1:][ended[:, :-1]][:, left] == 1.0).all()


def test_tianshou_resets_the_environments_it_names(excitation):
    tianshou = importlib.import_module("ppo_tianshou")
    env = tianshou.NativeVectorEnv(excitation.Excitation("Disabled", 0, 3))
    begun, _ = env.reset()
    for _ in range(3):
        flown, *_ = env.step(np.zeros((3, 3)))
    again, infos = env.reset([1])
    left = env.vector.unwrapped.problem.layout["time_left"]
    assert again.shape == (1, begun.shape[1])
    assert again[0, left] == 1.0
    assert infos.shape == (1,)
    following, *_ = env.step(np.zeros((3, 3)))
    assert (following[[0, 2], left] < flown[[0, 2], left]).all()
    with pytest.raises(ValueError, match=r"expected all 3 rows, got \[0, 2\]"):
        env.step(np.zeros((2, 3)), [0, 2])


def test_multipliers_rise_while_costs_are_above_their_limits(excitation):
    """Exploration bends the panels and stays within the rates' limit; plain PPO has no multipliers."""
    lagrangian = importlib.import_module("lagrangian_ppo")
    limits = {"rate": 0.5, "deflection": 0.01}
    actor, curve = lagrangian.train(9_600, 0, limits)
    assert [decisions for decisions, _, _ in curve] == [3200, 6400, 9600]
    assert all(rate < 0.5 and deflection > 0.02 for _, (rate, deflection), _ in curve)
    np.testing.assert_allclose([multipliers for _, _, multipliers in curve], [[0, 0.1], [0, 0.2], [0, 0.3]], rtol=1e-5)
    _, plain = lagrangian.train(3_200, 0, limits, constrained=False)
    assert plain[0][1] == curve[0][1]
    assert plain[0][2] == [0.0, 0.0]
    found = lagrangian.scores(actor, limits, 4)
    assert set(found) == {"final_error", "ended", "rate", "deflection"}
    assert all(0.0 <= value <= 1.0 for value in found.values())
