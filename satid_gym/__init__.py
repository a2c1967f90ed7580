"""Active identification of a satellite's time-varying inertia, as a Gymnasium environment."""

from gymnasium.envs.registration import register, registry

from satid_gym.appendages import Panels, Tank
from satid_gym.disturbance import Disturbance
from satid_gym.drawn_satellite import SatelliteRanges, draw_satellite, draw_satellites
from satid_gym.env import SatInertiaIDEnv
from satid_gym.friction import WheelFriction
from satid_gym.identification import Identification, identify
from satid_gym.law_ranges import LawRanges
from satid_gym.laws import INERTIA_MODES, MASS_MODES, InertiaLaw, paper_law
from satid_gym.manoeuvres import Design, KeepOut, design
from satid_gym.onboard import Pilot
from satid_gym.operations import Operations
from satid_gym.oscillators import Panel, SloshMass
from satid_gym.reaction_wheels import ReactionWheels
from satid_gym.reward import RewardSettings
from satid_gym.satellite import SATELLITES, Satellite
from satid_gym.scenario import Scenario
from satid_gym.scenario_catalogue import SCENARIOS
from satid_gym.sensors import Sensors
from satid_gym.simulation import Trajectory, simulate
from satid_gym.star_tracker import StarTracker
from satid_gym.tolerances import Tolerances
from satid_gym.vector import SatInertiaIDVectorEnv
from satid_gym.wheel_pyramid import WheelPyramid

__version__ = "0.2.0"

__all__ = [
    "INERTIA_MODES",
    "MASS_MODES",
    "SATELLITES",
    "SCENARIOS",
    "Design",
    "Disturbance",
    "Identification",
    "InertiaLaw",
    "KeepOut",
    "LawRanges",
    "Operations",
    "Panel",
    "Panels",
    "Pilot",
    "ReactionWheels",
    "RewardSettings",
    "SatInertiaIDEnv",
    "SatInertiaIDVectorEnv",
    "Satellite",
    "SatelliteRanges",
    "Scenario",
    "Sensors",
    "SloshMass",
    "StarTracker",
    "Tank",
    "Tolerances",
    "Trajectory",
    "WheelFriction",
    "WheelPyramid",
    "design",
    "draw_satellite",
    "draw_satellites",
    "identify",
    "paper_law",
    "simulate",
]

if "SatInertiaID-v0" not in registry:
    register(
        id="SatInertiaID-v0",
        entry_point="satid_gym.env:SatInertiaIDEnv",
        vector_entry_point="satid_gym.vector:SatInertiaIDVectorEnv",
    )
