"""Estimators of inertia from gyro and wheel speeds."""

from satid_gym.estimators import least_squares
from satid_gym.estimators.compiled import FilterRun
from satid_gym.estimators.filterpy.adaptive import FilterpyAdaptiveEKF
from satid_gym.estimators.filterpy.momentum import FilterpyMomentumEKF
from satid_gym.estimators.filterpy.rate import FilterpyRateEKF
from satid_gym.estimators.filterpy.unscented import FilterpyMomentumUKF
from satid_gym.estimators.momentum import AdaptiveEKF, MomentumEKF, MomentumEKFSettings
from satid_gym.estimators.prior import FilterPrior
from satid_gym.estimators.protocol import Estimator
from satid_gym.estimators.rate import RateEKF, RateEKFSettings
from satid_gym.estimators.registry import ESTIMATORS, estimator_settings
from satid_gym.estimators.settings import EstimatorSettings
from satid_gym.estimators.smoother import MomentumSmoother

__all__ = [
    "ESTIMATORS",
    "AdaptiveEKF",
    "Estimator",
    "EstimatorSettings",
    "FilterPrior",
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
    "estimator_settings",
    "least_squares",
]
