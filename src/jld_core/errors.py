"""The two ways a run can fail to be a run: bad input, and a program no route can take."""

from __future__ import annotations


class InputError(ValueError):
    """A scene, an option or a folder that cannot be used.

    where: file, then key or element (``scene.json: elements[3].polygon``); problem: what is wrong;
    expected: what would be right. Its text is one line of the three.
    """

    def __init__(self, where: str, problem: str, expected: str) -> None:
        self.where, self.problem, self.expected = where, problem, expected
        super().__init__(" ".join(f"{where}: {problem}; expected {expected}".split()))

    def within(self, file: str) -> InputError:
        """The same complaint with the name of the file it came from in front."""
        where = f"{file}: {self.where}" if self.where else file
        return InputError(where, self.problem, self.expected)


class SolverError(RuntimeError):
    """A solver route that was asked for a program it does not take."""
