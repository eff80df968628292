"""Outcome of a limit analysis."""

from __future__ import annotations

from enum import StrEnum


class Status(StrEnum):
    """Outcome of a limit analysis, backed by a proof where it is conclusive.

    Attributes
    ----------
    COLLAPSE
        Both bounds on λ are proven.
    LOCKED
        Every larger λ is admissible, by proof (docs/method.md (3.14)).
    UNSTABLE
        No λ ≥ 0 is admissible, by proof (docs/method.md (3.15)).
    UNCERTIFIED
        A bound is missing.
    FAILED
        The analysis ended without a result.
    """

    COLLAPSE = "collapse"
    LOCKED = "locked"
    UNSTABLE = "unstable"
    UNCERTIFIED = "uncertified"
    FAILED = "failed"
