"""Writes frames to video files one by one, as they are made: MP4 for players, GIF for pages."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Frame = NDArray[np.uint8]
"""An image, ``(height, width, 3)``."""

_PALETTE = "split[a][b];[a]palettegen=max_colors=96[p];[b][p]paletteuse=dither=none:diff_mode=rectangle"
_HOW: dict[str, dict[str, Any]] = {  # arguments of imageio_ffmpeg.write_frames
    ".mp4": {"codec": "libx264", "quality": 7},
    ".gif": {
        "codec": "gif",
        "pix_fmt_out": "pal8",
        "quality": None,
        # 96 colours for the whole film; without dither, what stands still takes no room
        "output_params": ["-filter_complex", _PALETTE],
    },
}


def check_formats(paths: list[Path]) -> None:
    """Refuse files that ``video_files`` cannot write.

    Raises:
        ValueError: if there are none, or one's suffix is another.
    """
    wrong = [str(path) for path in paths if path.suffix.lower() not in _HOW]
    if wrong or not paths:
        raise ValueError(f"paths={wrong}: give files that end in {' or '.join(_HOW)}.")


@contextmanager
def video_files(paths: list[Path], fps: float, size: tuple[int, int]) -> Iterator[Callable[[Frame], None]]:
    """Open files, and yield the function that writes the next frame to each of them.

    Args:
        paths: each ends in .mp4 or .gif.
        fps: frames per second.
        size: width and height of every frame, in pixels, both even.
    """
    from imageio_ffmpeg import write_frames

    with ExitStack() as stack:
        writers = []
        for path in paths:
            how = _HOW[path.suffix.lower()]
            writer = write_frames(path, size, fps=fps, macro_block_size=2, ffmpeg_log_level="error", **how)
            stack.callback(writer.close)
            writer.send(None)  # which starts ffmpeg
            writers.append(writer)

        def write(frame: Frame) -> None:
            for writer in writers:
                writer.send(np.ascontiguousarray(frame))

        yield write
