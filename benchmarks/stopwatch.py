"""Where time goes: methods wrapped from outside, each piece of time charged to the innermost one alone."""

from __future__ import annotations

import contextlib
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any
from unittest.mock import patch


@dataclass
class Stopwatch:
    """Seconds by part; time in a wrapped call made by another wrapped call counts for the inner one."""

    seconds: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))
    _parts: list[str] = field(default_factory=list)
    _since: float = 0.0

    def _charge(self) -> None:
        now = time.perf_counter()
        if self._parts:
            self.seconds[self._parts[-1]] += now - self._since
        self._since = now

    @contextlib.contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Charge what runs inside to a part."""
        self._charge()
        self._parts.append(name)
        try:
            yield
        finally:
            self._charge()
            self._parts.pop()

    def wrapped(self, call: Callable[..., Any], name: str) -> Callable[..., Any]:
        """The same call, charged to a part."""

        def run(*positional: Any, **keys: Any) -> Any:
            with self.part(name):
                return call(*positional, **keys)

        return run

    @contextlib.contextmanager
    def watching(self, targets: Sequence[tuple[Any, str, str]]) -> Iterator[None]:
        """Wrap (owner, attribute, part) while inside. AttributeError for an attribute that is not there."""
        with contextlib.ExitStack() as stack:
            for owner, attribute, name in targets:
                stack.enter_context(patch.object(owner, attribute, self.wrapped(getattr(owner, attribute), name)))
            yield

    def shares(self) -> dict[str, float]:
        """Part of the whole, by part."""
        total = sum(self.seconds.values())
        return {name: spent / total for name, spent in self.seconds.items()}
