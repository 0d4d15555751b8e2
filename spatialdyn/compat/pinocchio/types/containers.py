"""Lists of one type, as Pinocchio's std::vector bindings: values put in are copied, entries can be written in place."""

from __future__ import annotations

from collections.abc import Iterable
from copy import deepcopy
from typing import Any

import numpy as np

from .arguments import ArgumentError, described, module_of_caller
from .bases import Copied, OwnedValue, Owner
from .frame import Frame
from .inertia import Inertia
from .motion import Force, Motion
from .se3 import SE3
from .symmetric import Symmetric3
from .tracked_list import OwnedList
from .value import Value

__all__ = [
    "StdMap_String_VectorXd", "StdVec_Bool", "StdVec_BooleanVector", "StdVec_Double", "StdVec_EigenIndex",
    "StdVec_EigenIndexVector", "StdVec_Force", "StdVec_Frame", "StdVec_Index", "StdVec_IndexVector",
    "StdVec_Inertia", "StdVec_Matrix6", "StdVec_Matrix6x", "StdVec_MatrixXs", "StdVec_Motion", "StdVec_SE3",
    "StdVec_Scalar", "StdVec_StdString", "StdVec_StdVec_Int", "StdVec_Symmetric3", "StdVec_Vec3s", "StdVec_Vector3",
    "StdVec_int",
]  # fmt: skip


NO_OWNER = Owner(lambda: None)  # of lists


class StdVec(Copied, OwnedList[Any]):
    """A list of values of one type: ``StdVec_Force(values)``, ``StdVec_Force(count, value)``, ``StdVec_Force()``."""

    kind: type | tuple[type, ...] = object

    def __init__(self, values: Any = (), value: Any = None) -> None:
        if isinstance(values, int):
            values = [self._default() if value is None else value for _ in range(values)]
        elif not isinstance(values, Iterable):
            raise ArgumentError(f"values is a {type(values).__name__}, expected values or how many")
        super().__init__(NO_OWNER, self.kind, values)

    @classmethod
    def _default(cls) -> Any:
        return cls.kind[0]() if isinstance(cls.kind, tuple) else cls.kind()

    def _own(self, value: Any) -> Any:
        own = super()._own(np.array(value) if isinstance(value, np.ndarray) else value)
        return own if isinstance(own, (OwnedValue, Value)) else deepcopy(own)

    def __getitem__(self, at: Any) -> Any:
        found = super().__getitem__(at)
        return type(self)(found) if isinstance(at, slice) else found

    def copy(self) -> StdVec:
        """A list of the same type, of copies."""
        return type(self)(self)

    def tolist(self, deep_copy: bool = False) -> list[Any]:
        """The entries, or their copies, as a plain list."""
        return list(self.copy() if deep_copy else self)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (list(self),)

    __hash__ = object.__hash__  # type: ignore[assignment]


def list_class(name: str, kind: Any, what: str) -> Any:
    """The class ``StdVec_NAME`` of lists of a type, or of several types."""
    content = {"kind": kind, "__doc__": f"A list of {what}.", "__module__": module_of_caller()}
    return type(f"StdVec_{name}", (StdVec,), content)


StdVec_SE3, StdVec_Motion, StdVec_Inertia, StdVec_Frame, StdVec_Symmetric3 = (
    list_class(kind.__name__, kind, kind.__name__) for kind in (SE3, Motion, Inertia, Frame, Symmetric3)
)
StdVec_Force = list_class("Force", Force, "Force, such as the external forces of ``rnea`` and ``aba``")
StdVec_StdString, StdVec_Bool = list_class("StdString", str, "str"), list_class("Bool", (bool, np.bool_), "bool")
StdVec_Index = list_class("Index", (int, np.integer), "indices")
StdVec_Scalar = list_class("Scalar", (float, int, np.floating, np.integer), "numbers")
StdVec_Array = list_class("Array", np.ndarray, "arrays")
StdVec_List = list_class("List", (list, StdVec), "lists of indices")
StdVec_Double = StdVec_Scalar
StdVec_int = StdVec_EigenIndex = StdVec_Index
StdVec_Vector3 = StdVec_Vec3s = StdVec_Matrix6 = StdVec_Matrix6x = StdVec_MatrixXs = StdVec_Array
StdVec_IndexVector = StdVec_EigenIndexVector = StdVec_StdVec_Int = StdVec_BooleanVector = StdVec_List


class StdMap_String_VectorXd(dict[str, Any]):
    """Arrays by name, such as reference configurations."""

    def __setitem__(self, name: str, value: Any) -> None:
        if not isinstance(name, str) or not isinstance(value, np.ndarray):
            raise ArgumentError(f"{name!r} is {described(value)}, expected an array by a name")
        super().__setitem__(name, np.array(value, dtype=float).ravel())
