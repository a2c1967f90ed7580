"""Command: export a policy to ONNX; see `agents.training.onnx_export`."""

import sys

from agents.training.onnx_export import main
from baselines.command.cli import ended

if __name__ == "__main__":
    sys.exit(ended(main))
