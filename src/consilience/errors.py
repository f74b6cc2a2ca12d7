"""Errors a caller can act on: bad input is an exception, a numerical failure is a value in a `Run`."""

from __future__ import annotations


class ConsilienceError(Exception):
    """Anything wrong with what the user gave; the command line prints it and exits with 2."""


class InvalidInput(ConsilienceError):
    """A case file, a mechanism or an argument that cannot be used.

    Parameters
    ----------
    where : str
        File, field or name that is wrong, for example ``four_bar.toml: body[1].mass``.
    what : str
        What is wrong with it.
    remedy : str
        What would be right.
    """

    def __init__(self, where: str, what: str, remedy: str) -> None:
        super().__init__(f"{where}: {what}. {remedy}")
        self.where = where
        self.what = what
        self.remedy = remedy

    def __reduce__(self) -> tuple[type[InvalidInput], tuple[str, str, str]]:
        """Survive the trip out of a worker process with all three parts."""
        return type(self), (self.where, self.what, self.remedy)


class CannotAssemble(InvalidInput):
    """The mechanism has no configuration that satisfies its joints, or none was found from the drawing."""


class NumericalFailure(ConsilienceError):
    """A computation cannot go on; the message says when and why."""
