"""Manoeuvres that identify a satellite's inertia, designed for its data sheet and tested on random satellites."""

from satid_gym.manoeuvres.designer import Design, design
from satid_gym.manoeuvres.feasibility import NotPossibleError
from satid_gym.manoeuvres.policy import ManoeuvrePolicy
from satid_gym.manoeuvres.request import KeepOut, Request
from satid_gym.manoeuvres.search import Effort
from satid_gym.manoeuvres.trial import Trial
from satid_gym.manoeuvres.waves import Manoeuvre

__all__ = [
    "Design",
    "Effort",
    "KeepOut",
    "Manoeuvre",
    "ManoeuvrePolicy",
    "NotPossibleError",
    "Request",
    "Trial",
    "design",
]
