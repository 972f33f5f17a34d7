"""Options that several commands share and take as one argument."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Result = TypeVar("Result")
Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]


def grouped(
    command: Callable[..., Result], name: str, group: type[DataclassInstance], decorators: Sequence[Decorator]
) -> Callable[..., Result]:
    """Adds options to a command, which gets their values together.

    Args:
        command: what to add them to.
        name: of the command's argument.
        group: a dataclass whose fields are named as the options; other options that they may add stay on their own.
        decorators: what adds them, in the order of the help text.
    """
    names = [field.name for field in fields(group)]

    def with_group(*arguments: Any, **options: Any) -> Result:  # noqa: ANN401 - the command's own
        options[name] = group(**{option: options.pop(option) for option in names})
        return command(*arguments, **options)

    with_group.__doc__ = command.__doc__
    with_group.__name__ = command.__name__
    # Click collects the options of the decorators below here.
    with_group.__dict__.update(command.__dict__)
    wrapped: Callable[..., Result] = with_group
    for decorator in reversed(decorators):
        wrapped = decorator(wrapped)
    return wrapped
