"""Flight on board: a policy on readings that come from anywhere."""

from satid_gym.onboard.pilot import Pilot
from satid_gym.onboard.reports import Estimate, Status

__all__ = ["Estimate", "Pilot", "Status"]
