"""Telemetry: recorded gyro, wheel speeds and attitude, read from files into one form."""

from satid_gym.telemetry.log import Log
from satid_gym.telemetry.reader import read_log, read_logs

__all__ = ["Log", "read_log", "read_logs"]
