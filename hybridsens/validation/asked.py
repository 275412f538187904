"""What a user's function is asked: by what name, with which arguments, and of which class it is a method."""

import inspect
from collections.abc import Callable
from typing import Any, NamedTuple

import jax


class Asked(NamedTuple):
    """A function that a user wrote, beside how it must be written."""

    form: str
    """Its name and arguments: "force(t, q, v)"."""
    function: Any
    owner: type | None = None
    """The class whose method it is."""

    @staticmethod
    def of(thing: Any, form: str) -> "Asked":
        """A method of a scene or a system."""
        return Asked(form, getattr(thing, form.partition("(")[0]), type(thing))

    @property
    def name(self) -> str:
        """The name alone."""
        return self.form.partition("(")[0]

    @property
    def arguments(self) -> list[str]:
        """The names of its arguments, without `self`."""
        return self.form.partition("(")[2].rstrip(")").split(", ")

    @property
    def it(self) -> str:
        """Its second mention in a sentence: "but that of Ball returns ..."."""
        return "" if self.owner is None else f"that of {self.owner.__name__} "

    def __call__(self, *arguments) -> Any:
        """The function's own outcome. Raises: TypeError that says how to write it where it is written otherwise."""
        return self.call(self.function, *arguments)

    def call(self, function: Any, *arguments) -> Any:
        """The same of the function with other leaves: traced ones."""
        self.must_be_callable(function)
        if self._in_other_order():
            written = self._where(_written(self._as_written()))
            order = "arguments go by their places"
            raise TypeError(f"`{self.name}` must be {self._wanted}, but is {written}: {order}.{self._of_class()}")
        try:
            return function(*arguments)
        except TypeError as error:
            if _takes(function, arguments):
                raise
            written = self._where(_written(self._as_written()))
            raise TypeError(f"`{self.name}` must be {self._wanted}, but is {written}.{self._of_class()}") from error

    def must_be_callable(self, function: Any) -> None:
        """Raise TypeError for what is no function."""
        if not callable(function):
            raise TypeError(f"`{self.name}` must be {self._wanted}, but is {self._where(kind_of(self.function))}.")

    def _as_written(self) -> Any:
        """The function itself, of a method with its `self`."""
        return self.function if self.owner is None else getattr(self.owner, self.name)

    def _in_other_order(self) -> bool:
        """Whether two of its arguments bear each the name of another: they were meant to be given there."""
        names = self.arguments
        given = _parameters(self._as_written())
        given = given if self.owner is None else given[1:]
        moved = [name for name, here in zip(given, names, strict=False) if name != here and name in names]
        return len(moved) > 1

    def _of_class(self) -> str:
        """What to give in the place of a method of an object, whose `self` is taken already."""
        if self.owner is not None or not is_method(self.function):
            return ""
        of, name = type(self.function.__self__).__name__, self.function.__func__.__name__
        return f" Give the function of the class, {of}.{name}, in place of the method of one object."

    @property
    def _wanted(self) -> str:
        parameters = self.form.partition("(")[2]
        if self.owner is None:
            return f"a function of ({parameters}"
        own = "self" if parameters == ")" else "self, "
        return f"a method `def {self.name}({own}{parameters}`"

    def _where(self, written: str) -> str:
        return written if self.owner is None else f"{written} in {self.owner.__name__}"


def is_method(value: Any) -> bool:
    """Whether it is a method of an object; JAX takes one of a scene or a system for a tree of its parameters."""
    return hasattr(value, "__func__")


def kind_of(value: Any) -> str:
    """What was given, in a word or two; a class where one of its instances may be meant, a method where its outcome
    may."""
    if isinstance(value, type):
        return f"the class {value.__name__} itself: make one of it, {value.__name__}(...)"
    if is_method(value):
        return f"the method {value.__func__.__name__} itself: call it, {value.__func__.__name__}()"
    return "an array" if isinstance(value, jax.Array) else type(value).__name__


def _takes(function: Callable, arguments) -> bool:
    """Whether a function can be called with so many arguments; True of one that does not tell."""
    try:
        inspect.signature(function).bind(*arguments)
    except ValueError:
        return True
    except TypeError:
        return False
    return True


def _parameters(function: Any) -> list[str]:
    """Names of its parameters; none of a function that does not tell."""
    try:
        return list(inspect.signature(function).parameters)
    except (TypeError, ValueError):
        return []


def _written(function: Any) -> str:
    """`force(self, q)`: how a function was written, without its annotations."""
    given = inspect.signature(function).parameters.values()
    names = ", ".join(str(parameter.replace(annotation=inspect.Parameter.empty)) for parameter in given)
    return f"`{getattr(function, '__name__', type(function).__name__)}({names})`"
