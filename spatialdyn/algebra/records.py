"""Tables with spatial quantities as fields, which are read into tuples and written from tuples.

A table (of bodies, of scratch) is a structured array whose nested fields carry the same names, so one
attribute access reads the same in plain Python and in compiled code. ``DTYPES`` gives each type its layout;
``vec_of``, ``motion_of`` ... read a field into a tuple and ``put_vec``, ``put_motion`` ... write one back.
"""

from __future__ import annotations

from typing import Any, get_type_hints

import numpy as np

from .articulated import Articulated
from .coriolis_factor import CoriolisFactor
from .euclidean import Mat3, Sym, Vec
from .scalars import inline
from .spatial import Force, Inertia, Motion, Pose


def _layout(cls: type) -> np.dtype:
    """Structured dtype of a NamedTuple class, nested classes included."""
    hints = get_type_hints(cls).items()
    return np.dtype([(name, _layout(kind) if hasattr(kind, "_fields") else np.float64) for name, kind in hints])


TYPES: tuple[type, ...] = (Vec, Mat3, Sym, Motion, Force, Pose, Inertia, Articulated, CoriolisFactor)
DTYPES: dict[Any, np.dtype] = {cls: _layout(cls) for cls in TYPES}
DTYPES[float] = np.dtype(np.float64)
DTYPES[int] = np.dtype(np.int64)


def table_dtype(**fields: type | tuple[type, tuple[int, ...]]) -> np.dtype:
    """Dtype of a table whose columns are the given types (int, float or a type above, or an array of one: (float,
    shape)); rows read as attributes.
    """
    kinds = [(name, kind if isinstance(kind, tuple) else (kind, ())) for name, kind in fields.items()]
    columns = [(name, np.dtype((DTYPES[kind], shape))) for name, (kind, shape) in kinds]
    return np.dtype((np.record, np.dtype(columns, align=True)))


def object_twin(dtype: np.dtype) -> np.dtype:
    """The same table with every float replaced by an object, for engines whose numbers are not floats."""
    if dtype.names:
        return np.dtype((np.record, [(name, object_twin(dtype[name])) for name in dtype.names]))
    if dtype.subdtype:
        return np.dtype((object_twin(dtype.subdtype[0]), dtype.subdtype[1]))
    return np.dtype(object) if dtype.kind == "f" else dtype


@inline
def vec_of(r: Any) -> Vec:
    """Read a Vec field."""
    return Vec(r.x, r.y, r.z)


@inline
def mat3_of(r: Any) -> Mat3:
    """Read a Mat3 field."""
    return Mat3(r.xx, r.xy, r.xz, r.yx, r.yy, r.yz, r.zx, r.zy, r.zz)


@inline
def sym_of(r: Any) -> Sym:
    """Read a Sym field."""
    return Sym(r.xx, r.xy, r.xz, r.yy, r.yz, r.zz)


@inline
def motion_of(r: Any) -> Motion:
    """Read a Motion field."""
    return Motion(vec_of(r.w), vec_of(r.v))


@inline
def force_of(r: Any) -> Force:
    """Read a Force field."""
    return Force(vec_of(r.n), vec_of(r.f))


@inline
def pose_of(r: Any) -> Pose:
    """Read a Pose field."""
    return Pose(mat3_of(r.R), vec_of(r.p))


@inline
def inertia_of(r: Any) -> Inertia:
    """Read an Inertia field."""
    return Inertia(r.m, vec_of(r.h), sym_of(r.I))


@inline
def articulated_of(r: Any) -> Articulated:
    """Read an Articulated field."""
    return Articulated(sym_of(r.I), mat3_of(r.H), sym_of(r.M))


@inline
def coriolis_factor_of(r: Any) -> CoriolisFactor:
    """Read a CoriolisFactor field."""
    return CoriolisFactor(mat3_of(r.P), vec_of(r.p))


@inline
def put_vec(r: Any, a: Vec) -> None:
    """Write a Vec field."""
    r.x = a.x
    r.y = a.y
    r.z = a.z


@inline
def put_mat3(r: Any, A: Mat3) -> None:
    """Write a Mat3 field."""
    r.xx = A.xx
    r.xy = A.xy
    r.xz = A.xz
    r.yx = A.yx
    r.yy = A.yy
    r.yz = A.yz
    r.zx = A.zx
    r.zy = A.zy
    r.zz = A.zz


@inline
def put_sym(r: Any, A: Sym) -> None:
    """Write a Sym field."""
    r.xx = A.xx
    r.xy = A.xy
    r.xz = A.xz
    r.yy = A.yy
    r.yz = A.yz
    r.zz = A.zz


@inline
def put_motion(r: Any, m: Motion) -> None:
    """Write a Motion field."""
    put_vec(r.w, m.w)
    put_vec(r.v, m.v)


@inline
def put_force(r: Any, f: Force) -> None:
    """Write a Force field."""
    put_vec(r.n, f.n)
    put_vec(r.f, f.f)


@inline
def put_pose(r: Any, X: Pose) -> None:
    """Write a Pose field."""
    put_mat3(r.R, X.R)
    put_vec(r.p, X.p)


@inline
def put_inertia(r: Any, I: Inertia) -> None:
    """Write an Inertia field."""
    r.m = I.m
    put_vec(r.h, I.h)
    put_sym(r.I, I.I)


@inline
def put_articulated(r: Any, A: Articulated) -> None:
    """Write an Articulated field."""
    put_sym(r.I, A.I)
    put_mat3(r.H, A.H)
    put_sym(r.M, A.M)


@inline
def put_coriolis_factor(r: Any, B: CoriolisFactor) -> None:
    """Write a CoriolisFactor field."""
    put_mat3(r.P, B.P)
    put_vec(r.p, B.p)
