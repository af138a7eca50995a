"""Models of one kind combine: | & - and ^ of all of them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Self

from clvox.ops.combine import Operation


class Combinable(ABC):
    """What has Boolean combinations with others of its class."""

    @abstractmethod
    def _combined(self, other: Self, operation: Operation) -> Self:
        """What becomes of both; raises GridError if they do not go together."""

    def _with_its_like(self, other: Self, operation: Operation) -> Self:
        return self._combined(other, operation) if isinstance(other, type(self)) else NotImplemented

    def __or__(self, other: Self) -> Self:
        """What is inside either model."""
        return self._with_its_like(other, Operation.UNION)

    def __and__(self, other: Self) -> Self:
        """What is inside both models."""
        return self._with_its_like(other, Operation.INTERSECTION)

    def __sub__(self, other: Self) -> Self:
        """What is inside this model and not the other."""
        return self._with_its_like(other, Operation.DIFFERENCE)

    def __xor__(self, other: Self) -> Self:
        """What is inside exactly one of the models."""
        return self._with_its_like(other, Operation.XOR)
