"""Arguments as arrays and numbers, or errors that name them."""

from __future__ import annotations

import operator
from typing import Any

import numpy as np

from ._errors import InputError


def array(name: str, given: Any) -> Any:
    if isinstance(given, np.ma.MaskedArray):
        raise InputError(f"{name} is a masked array: expected plain numbers, of which none is left out")
    try:
        return np.asarray(given)
    except ValueError as error:
        raise InputError(f"{name} is no array: {error}") from None


def number(name: str, value: Any) -> float:
    try:
        return float(value)
    except (OverflowError, TypeError, ValueError):
        raise InputError(f"{name} is {value!r}: expected a number") from None


def count(name: str, value: Any, most: int = 2**31) -> int:
    try:
        found = operator.index(value)
    except TypeError:
        found = 0
    if not 1 <= found <= most:
        raise InputError(f"{name} is {value!r}: expected a whole number from 1 to {most}")
    return found
