"""Command: export a policy to ONNX; see `agents.training.graph.export`."""

from agents.training.graph.export import main
from baselines.command import cli

if __name__ == "__main__":
    cli.run(main)
