"""Data sheet of a satellite, looked over: what follows from it, what it leaves out, and doubts."""

from satid_gym.data_sheet.body_doubts import doubts
from satid_gym.data_sheet.consequences import Derived, DerivedMode, derived
from satid_gym.data_sheet.omissions import left_out

__all__ = ["Derived", "DerivedMode", "derived", "doubts", "left_out"]
