"""Active identification of a satellite's time-varying inertia, as a Gymnasium environment."""

from gymnasium.envs.registration import register, registry

from satid_gym.disturbance import Disturbance
from satid_gym.env import SatInertiaIDEnv
from satid_gym.laws import INERTIA_MODES, InertiaLaw, LawRanges, paper_law
from satid_gym.reward import RewardSettings
from satid_gym.satellite import SATELLITES, ReactionWheels, Satellite
from satid_gym.scenario import SCENARIOS, Scenario
from satid_gym.simulation import Trajectory, simulate
from satid_gym.tolerances import Tolerances
from satid_gym.vector import SatInertiaIDVectorEnv

__version__ = "0.1.0"

__all__ = [
    "INERTIA_MODES",
    "SATELLITES",
    "SCENARIOS",
    "Disturbance",
    "InertiaLaw",
    "LawRanges",
    "ReactionWheels",
    "RewardSettings",
    "SatInertiaIDEnv",
    "SatInertiaIDVectorEnv",
    "Satellite",
    "Scenario",
    "Tolerances",
    "Trajectory",
    "paper_law",
    "simulate",
]

if "SatInertiaID-v0" not in registry:
    register(
        id="SatInertiaID-v0",
        entry_point="satid_gym.env:SatInertiaIDEnv",
        vector_entry_point="satid_gym.vector:SatInertiaIDVectorEnv",
    )
