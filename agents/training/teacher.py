"""The teacher of imitation: a planner that says what each decision of a flight is worth, and files of its answers.

The planner takes a thousand times as long as a network, and is told what the network has to find out from its
observations: how the inertia varies.
"""

from __future__ import annotations

import io
import itertools
import os
import zipfile
import zlib
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from agents.training.settings import DRAWN, Task
from satid_gym import SatInertiaIDVectorEnv
from satid_gym.config import check_integer, check_number
from satid_gym.control.planning.planner import ADAPTIVE_WALK
from satid_gym.control.rate_loop import rate_loop
from satid_gym.evaluation import seeds
from satid_gym.files import DamagedFileError, write_bytes
from satid_gym.laws import INERTIA_MODES
from satid_gym.policies.learned import Network
from satid_gym.policies.mpc import MPCPolicy
from satid_gym.policy import missions
from satid_gym.satellite import Satellite

Answers = tuple[np.ndarray, np.ndarray]  # observations (D, size) and side values (D, 3) of the plus side
_STREAM = 6  # of who flies an episode: its seed alone is the environment's, with 5 a drawn satellite's


@dataclass(frozen=True, eq=False, kw_only=True)
class TeacherSettings(Task):
    """What is flown, and how well the teacher plans."""

    rounds: int = 6
    """Rounds of flights; the teacher flies the first, the network the others."""
    episodes: int = 24
    """Episodes a round on each satellite with each factor on its wheels; a drawn one flies one inertia mode."""
    taught: float = 0.15
    """Share of the later rounds' episodes that the teacher flies."""
    edits: int = 24
    """Edits of the plan that the teacher tries in each decision."""
    horizon: int = 40
    """Decisions that the teacher plans ahead."""
    steps: int = 4
    """Steps of the teacher's forecast in each decision."""
    walks: tuple[float, ...] = (ADAPTIVE_WALK, ADAPTIVE_WALK, 0.0003, 0.004)
    """What the teacher plans with where the filter is an AdaptiveEKF, by inertia mode (static, step, drift, periodic):
    random walk of the inertia, per sqrt(s). It is told the mode, the network is not. For a custom law it plans with
    the first."""
    tracked: bool = False
    """Whether the environment's own rate loop flies the rates (its `control="rate"`). The network then sees the wheels
    by what they do to the body, and the random walk that the filter uses."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("rounds", "edits", "horizon", "steps"):
            check_integer(name, getattr(self, name))
        low = len(self.modes) if self.satellite != DRAWN else 1
        check_integer("episodes, which are shared among the inertia modes,", self.episodes, low=low)
        check_number("taught", self.taught, high=1.0)
        if len(self.walks) != len(INERTIA_MODES):
            raise ValueError(
                f"walks must be {len(INERTIA_MODES)} numbers, one for each of {INERTIA_MODES}, got {self.walks}"
            )
        for walk in self.walks:
            check_number("walks", walk)

    @property
    def actions(self) -> str:
        """What actions of the environment are, its `control`."""
        return "rate" if self.tracked else "torque"

    def places(self, i: int) -> range | list[int]:
        """Places in the pool of what is flown in round i: all, of drawn satellites a share for each round."""
        if self.satellite != DRAWN:
            return range(len(self.pool()))
        scales = len(self.wheel_scales)  # each satellite has a place with each
        return [scales * own + k for own in range(i, self.drawn, self.rounds) for k in range(scales)]

    @property
    def observed(self) -> dict[str, Any]:
        """Settings of the environment whose observations the network is given."""
        own = {"observation": "body", "include_walk": True} if self.tracked else {}
        return {"control": self.actions, "include_covariance": True, **own}

    @property
    def modes(self) -> tuple[str, ...]:
        """Inertia modes that are flown."""
        return INERTIA_MODES if self.inertia == "random" else (self.inertia,)

    def modes_at(self, place: int, i: int) -> tuple[str, ...]:
        """Inertia modes that a place of the pool flies in round i: all, a drawn satellite one, the next the next one.

        It flies that one with every factor on its wheels, so that all pairs of mode and factor are flown.
        """
        if self.satellite != DRAWN:
            return self.modes
        turn = place // len(self.wheel_scales) // self.rounds + i + self.seed
        return (self.modes[turn % len(self.modes)],)


def teach(
    network: Network | None, satellite: Satellite, modes: Sequence[str], settings: TeacherSettings, skip: int
) -> Answers:
    """Fly episodes, shared evenly among inertia modes, and ask the teacher at every decision.

    Args:
        network: flies all but the share that the teacher does; None lets the teacher fly all.
        satellite: to fly.
        modes: how its inertia varies.
        settings: of the run.
        skip: how many of the training seeds to pass over, for others have had them.

    Returns:
        Observations (D, size) and the advantages (D, 3) of the plus side, see `Planner.side_value`; float32.
    """
    chosen = seeds("training", settings.episodes, skip)
    shares = [(mode, chosen[i :: len(modes)]) for i, mode in enumerate(modes)]
    said = [_teach(network, satellite, mode, settings, share) for mode, share in shares]
    return np.concatenate([x for x, _ in said]), np.concatenate([y for _, y in said])


def _teach(
    network: Network | None, satellite: Satellite, mode: str, settings: TeacherSettings, chosen: Sequence[int]
) -> Answers:
    """Episodes of one inertia mode, of which the teacher is told."""
    world: dict[str, Any] = {"satellite": satellite, "inertia": mode, "scenario": settings.scenario, "num_threads": 1}
    env = SatInertiaIDVectorEnv(len(chosen), **world, **settings.observed)
    # a planner needs the speed of each wheel: where the network does not see it, fly the same in parallel
    planned_env = SatInertiaIDVectorEnv(len(chosen), **world, control="rate") if settings.tracked else None
    (mission,) = missions((planned_env or env).problem)
    loop = rate_loop([mission], settings.margin)
    walk = settings.walks[INERTIA_MODES.index(mode) if mode in INERTIA_MODES else 0]  # type: ignore[arg-type]
    teacher = MPCPolicy(settings.horizon, settings.steps, settings.edits, settings.margin, walk)
    teacher.reset(mission, chosen)
    observation, _ = env.reset(seed=chosen)
    planned = observation if planned_env is None else planned_env.reset(seed=chosen)[0]
    taught = np.random.default_rng([chosen[0], _STREAM]).random((len(chosen), 1)) < settings.taught
    alive = np.ones(len(chosen), bool)
    observations, advantages = [], []
    for _ in range(mission.scenario.decisions):
        wanted, side_value = teacher.weigh(planned)
        observations.append(observation[alive])
        advantages.append(side_value[alive].astype(np.float32))
        command = wanted if network is None else np.where(taught, wanted, network(observation))
        actions = loop(planned, command)
        observation, _, terminated, *_ = env.step(actions)
        planned = observation if planned_env is None else planned_env.step(actions)[0]
        alive &= ~terminated
    for used in (env, planned_env):
        if used is not None:
            used.close()
    return np.concatenate(observations), np.concatenate(advantages)


def fly_round(
    network: Network | None, settings: TeacherSettings, i: int, on_flight: Callable[[], object] = lambda: None
) -> Answers:
    """Flights of round i, satellites side by side, on seeds that no other round has; `on_flight` is called after each.

    Of drawn satellites each round has its own share.
    """
    s, pool = settings, settings.pool()
    places = s.places(i)

    def fly(place: int) -> Answers:
        skip = ((s.seed * s.rounds + i) * len(pool) + place) * s.episodes
        said = teach(network, pool[place], s.modes_at(place, i), s, skip)
        on_flight()
        return said

    with ThreadPoolExecutor(os.cpu_count()) as executor:
        flights = [executor.submit(fly, place) for place in places]
        try:
            said = [flight.result() for flight in flights]
        except BaseException:
            executor.shutdown(cancel_futures=True)  # who interrupts waits for the flights under way alone
            raise
    return np.concatenate([x for x, _ in said]), np.concatenate([y for _, y in said])


def answers(folder: Path, rounds: int) -> list[Answers]:
    """What the teacher said in the whole rounds of a run, in the order they were flown.

    Raises:
        DamagedFileError: a round's file is damaged.
    """
    files = (_file(folder, i) for i in range(rounds))
    return [_load(file) for file in itertools.takewhile(Path.exists, files)]


def save_round(folder: Path, i: int, said: Answers) -> None:
    """Keep what the teacher said in round i."""
    buffer = io.BytesIO()
    np.savez(buffer, observations=said[0], advantages=said[1])
    write_bytes(_file(folder, i), buffer.getvalue())


def _file(folder: Path, i: int) -> Path:
    return folder / f"round-{i:02d}.npz"


def _load(file: Path) -> Answers:
    try:
        with np.load(file, allow_pickle=False) as said:
            return said["observations"], said["advantages"]
    except (ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        remedy = "remove it, and the run goes on from the round before"
        raise DamagedFileError(f"{file} is damaged ({error}): {remedy}") from error
