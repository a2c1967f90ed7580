"""Data sheet of a satellite, looked over before it is believed: what follows from it, what it leaves out, and doubts.

A value in another unit is often possible, and then every result is wrong by a factor that nothing shows. The doubts
compare the numbers of a satellite with each other. Their limits are wide: an unusual satellite passes, most slips of a
unit do not.
"""

from satid_gym.data_sheet.derived import Derived, DerivedMode, derived
from satid_gym.data_sheet.doubts import doubts
from satid_gym.data_sheet.left_out import left_out

__all__ = ["Derived", "DerivedMode", "derived", "doubts", "left_out"]
