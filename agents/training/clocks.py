"""Clocks: units of a network's first layer that begin as switches near the end of an episode.

A policy observes the time left as a fraction of the horizon, in which the last half minute, when reversals no longer
pay, is hardly told from the time before. As they are then trained, clocks are no more than a start.
"""

from __future__ import annotations

import torch

from satid_gym.problem import Problem

_LEFT = (3, 6, 10, 15, 22, 30)  # decisions before the end at which units begin to switch
_WIDTH = 0.35  # of a switch, in these


def set_clocks(layer: torch.nn.Module, posed: Problem) -> None:
    """Make clocks of the first units of a layer that takes the observations of a problem."""
    assert isinstance(layer, torch.nn.Linear)
    place, horizon = posed.layout["time_left"].start, posed.scenario.decisions
    with torch.no_grad():
        for i, left in enumerate(_LEFT[: layer.out_features]):
            width = _WIDTH * left
            layer.weight[i] = 0.0
            layer.weight[i, place] = -horizon / width
            layer.bias[i] = left / width
