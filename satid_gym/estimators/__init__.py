"""Estimators of inertia from gyro and wheel speeds.

State layout, stated once: [M, theta, tau] in momentum coordinates, [omega, theta, Omega] in rate coordinates,
theta = (Jxx, Jyy, Jzz) or (Jxx, Jyy, Jzz, Jxy, Jxz, Jyz), body frame, SI units.
"""

from satid_gym.estimators import least_squares
from satid_gym.estimators.compiled import AdaptiveEKF, FilterRun, MomentumEKF, RateEKF
from satid_gym.estimators.protocol import Estimator
from satid_gym.estimators.reference import FilterpyMomentumEKF, FilterpyMomentumUKF
from satid_gym.estimators.reference_adaptive import FilterpyAdaptiveEKF
from satid_gym.estimators.reference_rate import FilterpyRateEKF
from satid_gym.estimators.settings import (
    AdaptiveEKFSettings,
    Briefing,
    MomentumEKFSettings,
    RateEKFSettings,
    brief,
    estimator_settings,
)
from satid_gym.estimators.smoother import MomentumSmoother

__all__ = [
    "AdaptiveEKF",
    "AdaptiveEKFSettings",
    "Briefing",
    "Estimator",
    "FilterRun",
    "FilterpyAdaptiveEKF",
    "FilterpyMomentumEKF",
    "FilterpyMomentumUKF",
    "FilterpyRateEKF",
    "MomentumEKF",
    "MomentumEKFSettings",
    "MomentumSmoother",
    "RateEKF",
    "RateEKFSettings",
    "brief",
    "estimator_settings",
    "least_squares",
]
