"""Animation of a mechanism: GIF by pillow, MP4 by ffmpeg."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.animation import FFMpegWriter, PillowWriter

from jld_core.errors import InputError
from jld_core.limit import LimitAnalysisResult
from jld_core.views.figures import draw_mechanism, figure_of_mechanism
from jld_core.views.writing import as_written

FRAMES: Final = 24
"""Number of frames from rest to the drawn displacement and back; the opposite one would let blocks penetrate."""

PER_SECOND: Final = 12
"""Frames per second."""


def save_animation(result: LimitAnalysisResult, path: str | Path) -> None:
    """Write the mechanism of a result as a looped .gif or .mp4; raise InputError without mechanism or ffmpeg."""
    ending = Path(path).suffix.lower()
    if ending not in (".gif", ".mp4"):
        raise InputError(str(path), f"{ending!r} is no ending of an animation", "a name ending in .gif or .mp4")
    if ending == ".mp4" and shutil.which("ffmpeg") is None:
        raise InputError(str(path), "ffmpeg is not on this machine", "a name ending in .gif")
    if result.mechanism is None:
        raise InputError(result.assembly.name, f"it has no mechanism to move ({result.status})", "one that collapses")
    writer: Any = PillowWriter(fps=PER_SECOND) if ending == ".gif" else FFMpegWriter(fps=PER_SECOND)
    figure, ax = figure_of_mechanism(result)
    with writer.saving(figure, str(path), dpi=100):
        for k in range(FRAMES):
            ax.clear()
            draw_mechanism(ax, result, share=float(0.5 - 0.5 * np.cos(2.0 * np.pi * k / FRAMES)))
            with as_written(figure):
                writer.grab_frame()
