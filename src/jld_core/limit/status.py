"""What is said of a load factor, with proof."""

from __future__ import annotations

from enum import StrEnum


class Status(StrEnum):
    """What we say, with proof."""

    COLLAPSE = "collapse"
    LOCKED = "locked"
    UNSTABLE = "unstable"
    UNCERTIFIED = "uncertified"
    FAILED = "failed"
