"""What can go wrong: one small hierarchy, sorted as the command line's exit codes."""

from __future__ import annotations

from typing import Sequence, Tuple


class Error(Exception):
    """Any error of hydroline. Its words say what is wrong, with the numbers, and what to do."""

    #: Exit code of the command line for it.
    exit_code: int = 1


class InputError(Error, ValueError):
    """What was given cannot be used: a value, or a file that is missing, unreadable or of the wrong kind."""

    exit_code = 2


class ArgumentError(InputError):
    """An argument is missing, unknown, or not among its values.

    ``argument`` is its keyword ("" where none is to blame), ``value`` what it was, ``allowed`` the values that it can
    have where they are a list.
    """

    def __init__(
        self, words: str, argument: str = "", value: str = "", allowed: Sequence[str] = ()
    ) -> None:
        super().__init__(words)
        self.argument = argument
        self.value = value
        self.allowed: Tuple[str, ...] = tuple(allowed)


class RunError(Error, RuntimeError):
    """What was given is sound, but the work did not come to its end, or not to what was asked of it."""

    exit_code = 1


class LossyWarning(UserWarning):
    """Done, but something was lost (exit code 3): ``remarks`` of the result say what."""
