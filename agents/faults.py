"""The study of faults with the shipped policies beside the baselines: `python -m agents.faults`."""

from __future__ import annotations

import sys

from baselines import faults
from baselines.ending import ended
from satid_gym.policies.shipped import shipped

if __name__ == "__main__":
    sys.exit(ended(lambda: faults.main(shipped(), "agents.faults")))
