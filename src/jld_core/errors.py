"""Errors of the package: unusable input, and a program that a solver does not support."""

from __future__ import annotations


class InputError(ValueError):
    """Error for a scene, an option or a folder that cannot be used.

    The message is one line made of the three parameters.

    Parameters
    ----------
    where : str
        File, then key or element: ``scene.json: elements[3].polygon``.
    problem : str
        What is wrong.
    expected : str
        What would be right.
    """

    def __init__(self, where: str, problem: str, expected: str) -> None:
        self.where, self.problem, self.expected = where, problem, expected
        super().__init__(" ".join(f"{where}: {problem}; expected {expected}".split()))

    def within(self, file: str) -> InputError:
        """Return the same error with the name of a file in front of `where`.

        Parameters
        ----------
        file : str
            File that the error came from.
        """
        where = f"{file}: {self.where}" if self.where else file
        return InputError(where, self.problem, self.expected)


class SolverError(RuntimeError):
    """Error for a program that a solver does not support."""
