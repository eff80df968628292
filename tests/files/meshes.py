from __future__ import annotations

from files.make import File


def files() -> list[File]:
    return []
