"""The command line without pages and pictures of searches, as a program: more than two seconds of a process."""

from __future__ import annotations

import importlib
import runpy
from collections.abc import Callable


def leave_out_pictures(replace: Callable[[object, str, object], None] = setattr) -> None:
    """Let searches in this process write tables only; `replace` sets an attribute of a module."""
    module = importlib.import_module("jld_views")
    for name, nothing in (("write_pictures", ([], [])), ("write_report", None)):
        assert callable(getattr(module, name))
        replace(module, name, lambda *_, nothing=nothing, **__: nothing)


if __name__ == "__main__":
    leave_out_pictures()
    runpy.run_module("jld_explore", run_name="__main__")
