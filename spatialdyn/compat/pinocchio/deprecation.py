"""``pinocchio.deprecation``: a decorator for deprecated functions."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable
from typing import Any


class DeprecatedWarning(UserWarning):
    """A deprecated function was called."""


def deprecated(instructions: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """A decorator: calls of the function warn with DeprecatedWarning and these instructions.

    instructions  text, such as "use rnea"
    """

    def decorator(function: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(function)
        def wrapper(*arguments: Any, **named: Any) -> Any:
            text = f"{function.__name__} is deprecated: {instructions}"
            warnings.warn(text, category=DeprecatedWarning, stacklevel=2)
            return function(*arguments, **named)

        wrapper.__doc__ = "\n\n".join(filter(None, [function.__doc__, f"Deprecated: {instructions}"]))
        return wrapper

    return decorator


__all__ = ["DeprecatedWarning", "deprecated"]
