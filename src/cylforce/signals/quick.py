"""Named tuples and properties that are made or looked up in every step."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

__all__ = ["new", "once"]

new = tuple.__new__  # of a class and all fields in their order: its own constructor takes two to three times as long

if TYPE_CHECKING:
    from functools import cached_property as once
else:

    class once:  # noqa: N801 - a decorator
        """A property that is computed when it is first asked for, and kept. Python's own `cached_property` makes a
        dictionary of the object, after which each of its other fields takes twenty times as long to look up."""

        def __init__(self, make: Callable[[Any], Any]) -> None:
            self._make, self.__doc__ = make, make.__doc__

        def __set_name__(self, owner: type, name: str) -> None:
            self._name = name

        def __get__(self, instance: Any, owner: type | None = None) -> Any:  # noqa: ANN401 - of any object any value
            if instance is None:
                return self
            found = self._make(instance)
            object.__setattr__(instance, self._name, found)
            return found
