"""History of an episode for its pictures; it needs no drawing library."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from satid_gym.core.records import Cost
from satid_gym.laws import LAW_NAMES
from satid_gym.operations import Operations
from satid_gym.oscillators import oscillator_count
from satid_gym.satellite import Satellite


class History:
    """Truth and belief at the start and after each decision; for display only, since it contains the truth.

    Args:
        satellite: with its limits in operation.
        decisions: number of decisions of the episode.
        decision_period: duration of a decision, s.
        law: number of the inertia law in the core.
        orbit_rate: rad/s.
        operations: of the payload; None without one.

    Attributes:
        count: number of entries so far.
    """

    def __init__(
        self,
        satellite: Satellite,
        decisions: int,
        decision_period: float,
        law: int,
        orbit_rate: float = 0.0,
        operations: Operations | None = None,
    ) -> None:
        self.satellite, self.orbit_rate, self.operations = satellite, orbit_rate, operations
        self.horizon = decisions * decision_period
        self.mode = LAW_NAMES[law]
        self.count = 0
        self.sun = np.zeros(3)  # direction of the Sun, inertial frame, where it blinds a star tracker or a payload
        self.target = np.zeros(3)  # of the payload, inertial frame
        size, n = decisions + 1, satellite.wheels.count
        self._series = {
            "time": np.zeros(size),
            "attitude": np.zeros((size, 4)),
            "momentum": np.zeros((size, 3)),
            "rate": np.zeros((size, 3)),
            "wheel_speed": np.zeros((size, n)),
            "truth": np.zeros((size, 3)),
            "estimate": np.zeros((size, 3)),
            "std": np.zeros((size, 3)),
            "relative_error": np.zeros(size),
            "outside": np.zeros(size),
            "tracks": np.zeros(size),
            "windows": np.zeros((size, 2)),
            "missed": np.zeros(size),
            "deflection": np.zeros((size, oscillator_count(satellite.oscillators))),
        }

    def note(self, plant: np.void, belief: np.void, report: np.void) -> None:
        """Append the present state from the core's records."""
        i = self.count
        for name in ("time", "attitude", "momentum", "rate", "wheel_speed"):
            self._series[name][i] = plant[name]
        self._series["deflection"][i] = plant["oscillators"]["deflection"]
        self._series["truth"][i] = np.diag(report["inertia_true"])
        self._series["estimate"][i] = belief["mean"][3:6]
        common = belief["scale_variance"] * np.square(belief["mean"][3:6])  # of a factor that no excitation finds
        self._series["std"][i] = np.sqrt(np.diag(belief["covariance"])[3:6] + common)
        self._series["relative_error"][i] = report["relative_error"]
        self._series["outside"][i] = report["outside"]
        self._series["tracks"][i], self.sun = plant["tracker"]["tracks"], plant["tracker"]["sun"].copy()
        own, self.target = plant["operations"], plant["operations"]["target"].copy()
        self._series["windows"][i] = own["opens"], own["closes"]
        self._series["missed"][i] = report["costs"][Cost.WINDOW]
        self.count += 1

    def _noted(self, name: str) -> np.ndarray:
        return self._series[name][: self.count]

    @property
    def time(self) -> np.ndarray:
        """(N,) s."""
        return self._noted("time")

    @property
    def attitude(self) -> np.ndarray:
        """(N, 4) body to inertial, scalar last."""
        return self._noted("attitude")

    @property
    def momentum(self) -> np.ndarray:
        """(N, 3) total angular momentum, body frame, N m s."""
        return self._noted("momentum")

    @property
    def rate(self) -> np.ndarray:
        """(N, 3) body rates, rad/s."""
        return self._noted("rate")

    @property
    def wheel_speed(self) -> np.ndarray:
        """(N, n) relative to the body, rad/s."""
        return self._noted("wheel_speed")

    @property
    def truth(self) -> np.ndarray:
        """(N, 3) true moments of inertia about the body axes, kg m^2."""
        return self._noted("truth")

    @property
    def estimate(self) -> np.ndarray:
        """(N, 3) the filter's estimate of them, kg m^2."""
        return self._noted("estimate")

    @property
    def std(self) -> np.ndarray:
        """(N, 3) the filter's standard deviation of each, kg m^2."""
        return self._noted("std")

    @property
    def relative_error(self) -> np.ndarray:
        """(N,) as in info."""
        return self._noted("relative_error")

    @property
    def outside(self) -> float:
        """Share of the time so far with a rate outside its limit."""
        return float(self._noted("outside")[1:].mean()) if self.count > 1 else 0.0

    @property
    def tracks(self) -> np.ndarray:
        """(N,) whether the star tracker sees its stars, 1 or 0."""
        return self._noted("tracks")

    @property
    def windows(self) -> np.ndarray:
        """(N, 2) s, opening and closing of the imaging window that is open or comes next."""
        return self._noted("windows")

    @property
    def missed(self) -> np.ndarray:
        """(N,) cost "window" of each decision."""
        return self._noted("missed")

    @property
    def earth(self) -> np.ndarray:
        """(3,) direction of the Earth at the last entry, inertial frame; see `core.truth.star_tracker`."""
        angle = self.orbit_rate * self.time[-1]
        return np.array([np.cos(angle), np.sin(angle), 0.0])

    def to_body(self, direction: np.ndarray) -> np.ndarray:
        """An inertial direction (3,) in the body frame of the last entry."""
        return Rotation.from_quat(self.attitude[-1]).inv().apply(direction)

    @property
    def deflection(self) -> np.ndarray:
        """(N, c) of each panel, rad, and slosh mass, m, the two of a mirrored pair one after the other."""
        return self._noted("deflection")
