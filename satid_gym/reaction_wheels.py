"""Reaction wheels: axes, inertia, limits and friction."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

import numpy as np

from satid_gym.config import Config, real_array
from satid_gym.friction import WheelFriction

_LENGTH_TOLERANCE = 1e-6  # of a wheel axis, whose length must be 1
_SIGNS = 9  # wheels of which both signs are tried


@dataclass(frozen=True, eq=False, kw_only=True)
class ReactionWheels(Config):
    """Set of n >= 3 reaction wheels.

    Attributes:
        axes: (3, n) spin axes, unit columns, body frame; they must span space.
        inertia: spin inertia of a wheel, kg m^2, one number or (n,).
        max_torque: motor torque limit, N m, one number or (n,).
        max_speed: speed limit relative to the body, rad/s, one number or (n,).
        friction: friction of each wheel, or a mapping with its settings; none by default.
        avoided_speed: (low, high) rad/s, band of wheel speed, in both directions, that operators avoid, e.g. because a
            wheel shakes an instrument or loses its lubricant film; time in it is counted, and the rate loop keeps more
            than three wheels out of it. (0, 0): none.

    Raises:
        ValueError: a shape, a sign, a band or an axis is wrong.
    """

    axes: np.ndarray = field(default_factory=lambda: np.eye(3))
    inertia: np.ndarray
    max_torque: np.ndarray
    max_speed: np.ndarray
    friction: WheelFriction = field(default_factory=WheelFriction)
    avoided_speed: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        axes = real_array("wheel axes", self.axes)
        if axes.ndim != 2 or axes.shape[0] != 3 or axes.shape[1] < 3:
            raise ValueError(f"wheel axes must have shape (3, n) with n >= 3, got {axes.shape}")
        length = np.linalg.norm(axes, axis=0)
        if np.abs(length - 1.0).max() > _LENGTH_TOLERANCE:
            raise ValueError(f"wheel axes must be unit columns; their lengths are {length.tolist()}: divide by them")
        if np.linalg.matrix_rank(axes, tol=1e-6) < 3:
            raise ValueError("wheel axes must span space; these lie in a plane")
        axes = axes / length
        axes.flags.writeable = False
        object.__setattr__(self, "axes", axes)
        n = axes.shape[1]
        for name in ("inertia", "max_torque", "max_speed"):
            value = real_array(f"wheel {name}", getattr(self, name), (), (n,))
            if np.any(value <= 0.0):
                raise ValueError(f"wheel {name} must be positive, got {value.tolist()}")
            value = np.broadcast_to(value, n)
            object.__setattr__(self, name, value)

        self._settle("friction", WheelFriction)
        low, high = real_array("avoided_speed of the wheels", self.avoided_speed, (2,)).tolist()
        if not 0.0 <= low <= high:
            raise ValueError(
                f"avoided_speed of the wheels must be (low, high) with 0 <= low <= high, got ({low}, {high})"
            )
        object.__setattr__(self, "avoided_speed", (low, high))

    @property
    def count(self) -> int:
        """Number of wheels n."""
        return int(self.axes.shape[1])

    @property
    def max_momentum(self) -> np.ndarray:
        """Momentum (n,) of each wheel at its speed limit, N m s."""
        return self.inertia * self.max_speed

    @property
    def torque_reach(self) -> np.ndarray:
        """Torque (3,) of all wheels together about each body axis, N m."""
        return np.abs(self.axes) @ self.max_torque

    @property
    def momentum_reach(self) -> np.ndarray:
        """Momentum (3,) of all wheels together along each body axis, N m s."""
        return np.abs(self.axes) @ self.max_momentum

    @property
    def rotor_inertia(self) -> np.ndarray:
        """Inertia of the rotors about their spin axes, A j A^T (3, 3), kg m^2, which the free body lacks."""
        return (self.axes * self.inertia) @ self.axes.T

    @property
    def have_null_motion(self) -> bool:
        """Whether there are more than three, with a band of speed that null motion keeps them out of."""
        low, high = self.avoided_speed
        return self.count > 3 and high > low

    @property
    def null_direction(self) -> np.ndarray:
        """Relative momenta (n,) of n > 3 wheels that cancel; the largest is 1, the smallest as large as was found."""
        null = np.eye(self.count) - np.linalg.pinv(self.axes) @ self.axes
        signs = np.ones((2 ** min(self.count - 1, _SIGNS), self.count))
        signs[:, 1 : _SIGNS + 1] = list(itertools.product([1.0, -1.0], repeat=min(self.count - 1, _SIGNS)))
        ways = signs @ null
        ways = ways / np.maximum(np.abs(ways).max(axis=1, keepdims=True), _LENGTH_TOLERANCE)
        return ways[np.argmax(np.abs(ways).min(axis=1))]
