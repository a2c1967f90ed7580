"""Panels, a boom and a tank that tests bend and slosh, and how far an identified tensor is off."""

import numpy as np

from satid_gym import Panel, SloshMass
from satid_gym.estimators.inertia import inertia_parameters

TOLD = {"frequency_std": 0.2, "damping_std": 0.3, "mass_std": 0.1}  # of a data sheet whose modes are to be identified

PANELS = Panel(
    mass=1.2,
    hinge=[0.0, 0.3, 0.1],
    axis=[0.0, 0.0, 1.0],
    arm=[0.0, 0.6, 0.0],
    inertia=[0.144, 0.002, 0.1455],
    frequency=0.35,
    damping=0.005,
    mirrored=True,
)
BOOM = Panel(mass=0.4, hinge=[0.3, 0.0, 0.0], axis=[0.0, 0.6, 0.8], arm=[0.5, 0.0, 0.0], frequency=0.8, damping=0.002)
TANK = SloshMass(mass=3.0, position=[0.2, 0.1, -0.1], direction=[0.0, 0.6, 0.8], frequency=0.05, damping=0.05)


def tensor_errors(found, truth):
    """Of the six parameters, relative to the mean moment."""
    theta = np.array([parameter.value for parameter in found.parameters[:6]])
    return (theta - inertia_parameters(truth.inertia, "full")) / np.diag(truth.inertia).mean()
