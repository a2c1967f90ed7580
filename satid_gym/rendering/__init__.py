"""Pictures of an episode, drawn by `SatInertiaIDEnv(render_mode="rgb_array")`; needs pygame."""

from satid_gym.rendering.frame import draw
from satid_gym.rendering.history import History

__all__ = ["History", "draw"]
