"""Data sheets of satellites: what observations in the form "body" leave out of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from satid_gym.control.decoded_observation import times
from satid_gym.policy import Mission


class Craft(NamedTuple):
    """Numbers of the data sheets of N satellites.

    Attributes:
        inertia: (N, 3, 3) of the prior, kg m^2.
        momentum: (N, 3) that all wheels together have along each body axis, N m s.
        rate_limit: (N,) rad/s.
        noise: (N,) variance of the mean of a second of gyro samples, over the rate limit squared.
    """

    inertia: np.ndarray
    momentum: np.ndarray
    rate_limit: np.ndarray
    noise: np.ndarray

    @classmethod
    def of(cls, missions: Sequence[Mission]) -> Craft:
        """Data sheets of the missions."""
        rows = []
        for mission in missions:
            satellite, wheels = mission.satellite, mission.satellite.wheels
            noise = mission.scenario.sample_period * (satellite.gyro_noise_std / satellite.rate_limit) ** 2
            rows.append((mission.prior.inertia, wheels.momentum_reach, satellite.rate_limit, noise))
        return cls(*(np.array(part) for part in zip(*rows, strict=True)))

    def stored(self, tensor: np.ndarray, rate: np.ndarray, wheel_momentum: np.ndarray) -> np.ndarray:
        """Total momentum (N, 3), body frame, N m s.

        Args:
            tensor: (N, 3, 3) inertia that is believed, kg m^2.
            rate: (N, 3) of the body, over its limit.
            wheel_momentum: (N, 3) over the most that wheels can have.
        """
        return times(tensor, rate) * self.rate_limit[:, None] + self.momentum * wheel_momentum

    def take(self, rows: np.ndarray) -> Craft:
        """Data sheets of some rows."""
        return Craft(*(part[rows] for part in self))
