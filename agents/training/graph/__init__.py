"""Graphs of policies: ONNX operators on rows of a batch, the rate loop's kernel made of them, and the export."""
