"""Graphs of policies: ONNX operators on rows of a batch, and the rate loop's kernel made of them."""
