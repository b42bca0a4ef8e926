"""What goes wrong, with the same words as in Rust."""


class Error(Exception):
    """Every way in which farfield refuses something."""


class InputError(Error, ValueError):
    """Points, charges or options that can't be summed. The message names which, and what was expected."""


class KernelError(InputError):
    """A kernel that is neither a known name nor a formula, or whose parameters are not its own.

    The message has a line with a caret under the character that is wrong.
    """


class ToleranceError(Error, ValueError):
    """A tolerance that can't be met. The message says what can."""


class SumError(Error, ArithmeticError):
    """A sum that is not finite although all inputs are."""
