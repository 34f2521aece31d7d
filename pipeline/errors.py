"""The errors a user can cause, each one line: what and where, what was found, what would be right."""

from __future__ import annotations

import traceback


class SearchlightError(Exception):
    """Root of every error that the command line prints as one line with exit code 2."""

    exit_code = 2
    #: lines to show below the message, such as a section to fill in
    details = ""


class InputError(SearchlightError):
    """An input that cannot be used.

    Parameters
    ----------
    where: the file, with the line or the field if known, e.g. ``mission.yaml:12 fusion.cell_size``.
    found: the offending value, as the user would recognise it.
    expected: what would be right.
    """

    def __init__(self, where: object, found: str, expected: str) -> None:
        self.where, self.found, self.expected = str(where), found, expected
        super().__init__(f"{where}: found {found}; expected {expected}")

    def __reduce__(self) -> tuple[type[InputError], tuple[str, str, str]]:
        return type(self), (self.where, self.found, self.expected)


class SeveralInputsError(InputError):
    """Several inputs that cannot be used; one line for each."""

    def __init__(self, faults: tuple[InputError, ...]) -> None:
        self.faults = faults
        SearchlightError.__init__(self, "\n".join(str(fault) for fault in faults))
        self.details = "\n".join(fault.details for fault in faults if fault.details)

    def __reduce__(self) -> tuple[type[SeveralInputsError], tuple[tuple[InputError, ...]]]:  # type: ignore[override]
        return type(self), (self.faults,)


class NoPlanError(SearchlightError):
    """The allocation problem has no solution; the message names the limits that clash."""


class NoPlanInTimeError(SearchlightError):
    """The time limit came before any plan; there may be one."""

    exit_code = 3


class ProtocolError(SearchlightError):
    """Bytes from the wire that are not a message of ours; the connection is closed.

    reason: one of few words, to count by.
    """

    def __init__(self, message: str, reason: str = "not_a_message") -> None:
        self.reason = reason
        super().__init__(message)

    def __reduce__(self) -> tuple[type[ProtocolError], tuple[str, str]]:
        return type(self), (str(self), self.reason)


class StoppedError(SearchlightError):
    """The user ended the program, by a signal, before there was anything to keep."""

    def __init__(self, signal_name: str, signal_number: int) -> None:
        self.signal_name, self.signal_number = signal_name, signal_number
        self.exit_code = 128 + signal_number
        super().__init__(f"stopped by {signal_name} before the first frame; nothing was written")

    def __reduce__(self) -> tuple[type[StoppedError], tuple[str, int]]:
        return type(self), (self.signal_name, self.signal_number)


class RunFailedError(SearchlightError):
    """Something broke that the user did not cause; the message carries where."""

    exit_code = 1


class InvalidPlanError(RunFailedError):
    """A solver's plan breaks a limit of its problem; the message names the faults. It is not handed out."""


def in_one_line(error: BaseException) -> str:
    """What went wrong, without the way there: the last line of a traceback."""
    lines = [line for line in str(error).splitlines() if line.strip()]
    return lines[-1].strip() if lines else type(error).__name__


def failure(error: Exception) -> SearchlightError:
    """An error as it travels from an actor: ours as it is, any other with its traceback as text."""
    if isinstance(error, SearchlightError):
        return error
    return RunFailedError("".join(traceback.format_exception(error)))
