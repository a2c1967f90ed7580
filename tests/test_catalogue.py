"""The catalogue of satellites: one that is added changes no draw, no training pool and no cell of the benchmark."""

import numpy as np
import pytest

from agents.benchmark.acceptance import missing
from agents.benchmark.compare import Comparison
from agents.benchmark.evaluate import Evaluation
from agents.docs import tables
from agents.training.ppo import PPOSettings
from baselines.tuning.amplitudes import Tuning
from baselines.tuning.open_loop_design import Design
from satid_gym import SATELLITES, Satellite, SatInertiaIDEnv, SatInertiaIDVectorEnv
from satid_gym.laws import INERTIA_MODES
from satid_gym.satellite import BENCHMARK_SATELLITES
from tests.cases import cases

WHEELS = SATELLITES["microsat"].wheels
MEGASAT = Satellite("megasat", [50.0, 60.0, 70.0], WHEELS)
PYRAMID = MEGASAT.replace(  # four wheels: with it in a pool no environment could be made
    name="pyramid",
    wheels=WHEELS.replace(
        axes=np.array([[1, 1, -1, -1], [1, -1, 1, -1], [1, -1, -1, 1]]) / np.sqrt(3.0),
        inertia=2e-3,
        max_torque=0.1,
        max_speed=900.0,
    ),
)


def draws():
    """What "random" draws: true inertia and first observation of episodes, alone and side by side."""
    env, found = SatInertiaIDEnv(satellite="random"), []
    for seed in range(12):
        observation, info = env.reset(seed=seed)
        found.append((info["inertia_true"].tolist(), observation.tolist()))
    observation, info = SatInertiaIDVectorEnv(64, satellite="random").reset(seed=3)
    return found, info["inertia_true"].tolist(), observation.tolist()


def pool():
    return [satellite.to_dict() for satellite in PPOSettings().pool()]


def cells():
    """Cells of a comparison with who flies in each, and of the other commands by default."""
    comparison = Comparison(all=True)
    entrants = comparison.entrants()
    flown = {name: [policy.name for policy in policies] for name, policies in entrants.policies_for.items()}
    defaults = [kind.satellites for kind in (comparison, Evaluation(policy="ppo"), Tuning(), Design())]
    return flown, [satellite.name for satellite in entrants.satellites], entrants.not_tuned, defaults


@pytest.fixture(params=[MEGASAT, PYRAMID], ids=lambda satellite: satellite.name)
def add(request):
    """Adds a satellite to the catalogue, before all others, and returns it."""
    own = dict(SATELLITES)

    def put_first():
        SATELLITES.clear()
        SATELLITES.update({request.param.name: request.param}, **own)
        return request.param

    yield put_first
    SATELLITES.clear()
    SATELLITES.update(own)


@cases("of", [draws, pool, cells])
def test_a_satellite_added_to_the_catalogue_changes_nothing(of, add):
    before = of()
    satellite = add()
    assert next(iter(SATELLITES)) == satellite.name
    assert SatInertiaIDEnv(satellite=satellite.name).problem.satellites == (satellite,)
    assert of() == before


def test_nor_what_the_verdict_needs_and_the_tables_of_baselines(add):
    records = [{"policy": "p", "satellite": s, "inertia_mode": m} for s in BENCHMARK_SATELLITES for m in INERTIA_MODES]
    results = {"records": records, "pairs": [], "efficiencies": []}
    before = tables.baselines()
    satellite = add()
    assert missing(results, ["p"], []) is None
    assert tables.baselines() == before
    assert satellite.name in tables.satellites()  # the catalogue itself is shown in full
