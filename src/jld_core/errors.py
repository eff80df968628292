"""Errors of the package: unusable input, and a program that a solver does not support."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


class InputError(ValueError):
    """Error for a scene, a parameter or a folder that cannot be used.

    The message is one line made of the three parameters. Parameters of functions that it names stand in backticks,
    as in `friction="zero-dilation"`; the command line replaces them by its flags.

    Parameters
    ----------
    where : str
        File, then key or element: ``scene.json: elements[3].polygon``.
    problem : str
        The fault, such as "it is negative".
    expected : str
        Description of a valid value.

    Attributes
    ----------
    parameter : str
        Name of the parameter with a wrong value; "" if the error is about a file, an element or a folder.
    """

    parameter: str = ""

    def __init__(self, where: str, problem: str, expected: str) -> None:
        self.where, self.problem, self.expected = where, problem, expected
        super().__init__(" ".join(f"{where}: {problem}; expected {expected}".split()))

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the constructor call, so that workers can send the error to another process."""
        return type(self), (self.where, self.problem, self.expected)

    def within(self, file: str) -> InputError:
        """Return the same error with the name of a file in front of `where`.

        Parameters
        ----------
        file : str
            File that the error came from.

        Returns
        -------
        InputError
            New error of the plain class InputError, to be raised in place of this one.
        """
        where = f"{file}: {self.where}" if self.where else file
        return InputError(where, self.problem, self.expected)


class ParameterError(InputError):
    """Error for a parameter of a function, or an option of a command, with a wrong value."""

    def __init__(self, parameter: str, problem: str, expected: str) -> None:
        super().__init__(parameter, problem, expected)
        self.parameter = parameter


@contextmanager
def error_context(file: str | Path, *outside: str) -> Iterator[None]:
    """Add the name of a file to errors about its content.

    Raises InputError: the error raised within the context.

    Parameters
    ----------
    file : str or Path
        Name of the file.
    *outside : str
        Errors about paths that begin with one of these stay unchanged, as errors about parameters do.

    Yields
    ------
    None
        Nothing.
    """
    try:
        yield
    except InputError as error:
        unchanged = error.parameter or (outside and error.where.startswith(outside))
        raise (error if unchanged else error.within(str(file))) from None


class SolverError(RuntimeError):
    """Error for a program of a kind that the chosen solver cannot handle."""
