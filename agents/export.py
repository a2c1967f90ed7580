"""Command: export a policy to ONNX; see `agents.training.onnx_export`."""

from agents.training.onnx_export import main
from baselines.command import cli

if __name__ == "__main__":
    cli.run(main)
