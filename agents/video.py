"""Videos: mp4 through the ffmpeg that imageio-ffmpeg brings, gif through Pillow; written whole or not at all."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

import imageio_ffmpeg
import numpy as np
from PIL import Image

FORMATS = (".mp4", ".gif")
_GIF_COLOURS = 128
_LAST = 2.0  # s that a gif rests before it begins again


def check_path(path: Path) -> None:
    """Refuse a file that cannot be written, before work is spent on it.

    Raises:
        ValueError: its ending is of no format known here.
        OSError: its folder cannot be made or written to.
    """
    if path.suffix not in FORMATS:
        raise ValueError(f"a video's name must end in {' or '.join(FORMATS)}, got {str(path)!r}")
    if path.is_dir():
        raise IsADirectoryError(f"{path} is a folder; name a file")
    with _whole(path, keep=False):
        pass


def write(path: Path, frames: Iterable[np.ndarray], fps: int) -> None:
    """Write a video.

    Args:
        path: ends in .mp4 or .gif.
        frames: (height, width, 3) uint8 each, of one size.
        fps: frames a second.

    Raises:
        ValueError: there is no frame.
    """
    with _whole(path) as file:
        if path.suffix == ".gif":
            _write_gif(file, frames, fps)
        else:
            _write_mp4(file, frames, fps)


@contextlib.contextmanager
def _whole(path: Path, keep: bool = True) -> Iterator[Path]:
    """A temporary file beside `path` that takes its place when all has gone well."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(suffix=path.suffix, prefix=path.stem, dir=path.parent)
    os.close(handle)
    file = Path(name)
    try:
        yield file
        if keep:
            file.chmod(0o644)
            os.replace(file, path)
    finally:
        file.unlink(missing_ok=True)


def _write_mp4(file: Path, frames: Iterable[np.ndarray], fps: int) -> None:
    writer = None
    try:
        for frame in frames:
            height, width = frame.shape[0] // 2 * 2, frame.shape[1] // 2 * 2  # H.264 halves both for its colours
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
    # without dithering what stands still stays the same from frame to frame, which the format does not repeat
    reduced = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    durations = [round(1000 / fps)] * len(reduced)
    durations[-1] += round(1000 * _LAST)
    reduced[0].save(
        file, save_all=True, append_images=reduced[1:], duration=durations, loop=0, optimize=True, disposal=1
    )


def _palette(pictures: list[Image.Image]) -> Image.Image:
    """Colours that serve all of them."""
    together = Image.fromarray(np.concatenate([np.asarray(picture) for picture in pictures]))
    return together.quantize(_GIF_COLOURS, method=Image.Quantize.FASTOCTREE)  # keeps rare ones, such as arrows
