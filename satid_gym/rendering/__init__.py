"""Pictures of an episode for people; `SatInertiaIDEnv(render_mode="rgb_array")` draws them. Needs pygame."""

from satid_gym.rendering.frame import draw
from satid_gym.rendering.history import History

__all__ = ["History", "draw"]
