"""Conflicts on disk, so that a proof that was stopped goes on where it was.

A key that says what they were proven of, then one record of fixed length per conflict: which faces, their labels, the
bound, a checksum. What a kill tears off is cut; a file with another key is begun anew.
"""

from __future__ import annotations

import hashlib
import os
import struct
import time
import zlib
from pathlib import Path
from typing import Final

import numpy as np

from jld_core.program import Template
from jld_explore.drivers.exact.conflicts import Conflict
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks
from jld_explore.space import SearchSpace

CONFLICTS_FILE: Final = "conflicts.jld"

_EVERY: Final = 0.5
"""Seconds between two waits for the disk."""


def key_of(template: Template, space: SearchSpace, blocks: PossibleBlocks | None) -> bytes:
    """What conflicts depend on: the numbers of the programs, which faces are free, which blocks there can be."""
    pattern = template.yield_set.pattern
    numbers = (template.matrix.data, template.dead, template.live, pattern.dry, pattern.inner)
    rows = (pattern.h_dry, pattern.h_inner, space.candidates, space.fixed, space.group)
    names = repr(None if blocks is None else blocks.members).encode()
    return hashlib.sha256(b"".join([*(part.tobytes() for part in (*numbers, *rows)), names])).digest()


class Record:
    """Conflicts of a study in its folder. faces: m. key: of fixed length. `known`: those that were there."""

    def __init__(self, folder: Path, faces: int, key: bytes) -> None:
        path = folder / CONFLICTS_FILE
        self._faces, self._bytes = faces, (faces + 7) // 8
        self._size = 2 * self._bytes + 12
        content = path.read_bytes() if path.exists() else b""
        self.known: list[Conflict] = []
        old = content.startswith(key)
        good = len(key)
        while old and good + self._size <= len(content):
            body, check = content[good : good + self._size - 4], content[good + self._size - 4 : good + self._size]
            if zlib.crc32(body) != struct.unpack("<I", check)[0]:
                break
            self.known.append(self._conflict(body))
            good += self._size
        self._file = open(path, "r+b" if path.exists() else "w+b", buffering=0)  # noqa: SIM115
        if not old:
            self._file.write(key)
        self._file.truncate(good)
        self._file.seek(good)
        self._synced = time.monotonic()

    def append(self, conflict: Conflict) -> None:
        """Write a conflict; a kill loses none that was written, loss of power those of the last moment."""
        decided, labels = np.zeros((2, self._faces), dtype=bool)
        decided[conflict.faces], labels[conflict.faces] = True, conflict.labels
        body = np.packbits(decided).tobytes() + np.packbits(labels).tobytes() + struct.pack("<d", conflict.bound)
        self._file.write(body + struct.pack("<I", zlib.crc32(body)))
        if time.monotonic() - self._synced > _EVERY:
            os.fsync(self._file.fileno())
            self._synced = time.monotonic()

    def close(self) -> None:
        """Wait for the disk and close the file."""
        os.fsync(self._file.fileno())
        self._file.close()

    def _conflict(self, body: bytes) -> Conflict:
        masks = np.frombuffer(body, np.uint8, 2 * self._bytes).reshape(2, -1)
        decided, labels = np.unpackbits(masks, axis=1, count=self._faces).astype(bool)
        faces = np.flatnonzero(decided)
        return Conflict(faces, labels[faces], struct.unpack_from("<d", body, 2 * self._bytes)[0])
