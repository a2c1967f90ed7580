"""Video files, written atomically: mp4 by the ffmpeg of imageio-ffmpeg, gif by Pillow; both are in extra "render"."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import imageio_ffmpeg
import numpy as np
from PIL import Image

from satid_gym.files import check_writable, replacing

FORMATS = (".mp4", ".gif")
_GIF_COLOURS = 128
_LAST_FRAME = 2.0  # s for which a gif shows its last frame before it is repeated


def check_path(path: Path) -> None:
    """Check before any work that a video can be written to a file.

    Raises:
        ValueError: its ending is not that of a known format.
        OSError: its folder cannot be made or written to.
    """
    if path.suffix not in FORMATS:
        raise ValueError(f"a video's name must end in {' or '.join(FORMATS)}, got {str(path)!r}")
    if path.is_dir():
        raise IsADirectoryError(f"{path} is a folder; name a file")
    check_writable(path.parent)


def write(path: Path, frames: Iterable[np.ndarray], fps: int) -> None:
    """Write a video.

    Args:
        path: ends in .mp4 or .gif.
        frames: (height, width, 3) uint8 each, all of one size.
        fps: frames per second.

    Raises:
        ValueError: `frames` is empty.
    """
    with replacing(path, path.suffix) as file:
        if path.suffix == ".gif":
            _write_gif(file, frames, fps)
        else:
            _write_mp4(file, frames, fps)


def _write_mp4(file: Path, frames: Iterable[np.ndarray], fps: int) -> None:
    writer = None
    try:
        for frame in frames:
            height, width = frame.shape[0] // 2 * 2, frame.shape[1] // 2 * 2  # H.264 stores colours at half the size
            if writer is None:
                writer = imageio_ffmpeg.write_frames(
                    str(file), (width, height), fps=fps, quality=8, macro_block_size=2, ffmpeg_log_level="error"
                )
                writer.send(None)
            writer.send(np.ascontiguousarray(frame[:height, :width]))
    finally:
        if writer is not None:
            writer.close()
    if writer is None:
        raise ValueError("a video needs at least one frame")


def _write_gif(file: Path, frames: Iterable[np.ndarray], fps: int) -> None:
    pictures = [Image.fromarray(frame) for frame in frames]
    if not pictures:
        raise ValueError("a video needs at least one frame")
    palette = _palette([pictures[i] for i in np.linspace(0, len(pictures) - 1, 4).astype(int)])
    # without dithering, still parts are identical from frame to frame, which the format stores only once
    reduced = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    durations = [round(1000 / fps)] * len(reduced)
    durations[-1] += round(1000 * _LAST_FRAME)
    reduced[0].save(
        file, save_all=True, append_images=reduced[1:], duration=durations, loop=0, optimize=True, disposal=1
    )


def _palette(pictures: list[Image.Image]) -> Image.Image:
    """Palette for all pictures."""
    together = Image.fromarray(np.concatenate([np.asarray(picture) for picture in pictures]))
    return together.quantize(_GIF_COLOURS, method=Image.Quantize.FASTOCTREE)  # keeps rare colours: arrows
