"""Identification of the inertia from recorded flights."""

from satid_gym.estimators.batch.fit import NotIdentifiedError
from satid_gym.identification.delays import Parameter
from satid_gym.identification.identify import Identification, identify
from satid_gym.identification.slips.checks import SlipError
from satid_gym.identification.variation.steps_and_drift import Step, Variation

__all__ = ["Identification", "NotIdentifiedError", "Parameter", "SlipError", "Step", "Variation", "identify"]
