"""Tables, whose fields are spatial quantities: reading them into tuples, writing tuples back, and public arrays.

A table (of bodies, of scratch) is a structured array whose nested fields carry the same names, so one
attribute access reads the same in plain Python and in compiled code. ``DTYPES`` gives each type its layout;
``vec_of``, ``motion_of`` ... read a field into a tuple and ``put_vec``, ``put_motion`` ... write one back.
"""

from __future__ import annotations

from typing import Any, get_type_hints

import numpy as np

from .articulated import Articulated
from .coriolis_factor import Coupling
from .euclidean import Rot, Sym, Vec
from .scalars import inlined
from .spatial import Force, Inertia, Motion, Pose


def _layout(cls: type) -> np.dtype:
    """Structured dtype of a NamedTuple class, nested classes included."""
    hints = get_type_hints(cls).items()
    return np.dtype([(name, _layout(kind) if hasattr(kind, "_fields") else np.float64) for name, kind in hints])


TYPES: tuple[type, ...] = (Vec, Rot, Sym, Motion, Force, Pose, Inertia, Articulated, Coupling)
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


@inlined
def vec_of(r: Any) -> Vec:
    """Read a Vec field."""
    return Vec(r.x, r.y, r.z)


@inlined
def rot_of(r: Any) -> Rot:
    """Read a Rot field."""
    return Rot(r.xx, r.xy, r.xz, r.yx, r.yy, r.yz, r.zx, r.zy, r.zz)


@inlined
def sym_of(r: Any) -> Sym:
    """Read a Sym field."""
    return Sym(r.xx, r.xy, r.xz, r.yy, r.yz, r.zz)


@inlined
def motion_of(r: Any) -> Motion:
    """Read a Motion field."""
    return Motion(vec_of(r.w), vec_of(r.v))


@inlined
def force_of(r: Any) -> Force:
    """Read a Force field."""
    return Force(vec_of(r.n), vec_of(r.f))


@inlined
def pose_of(r: Any) -> Pose:
    """Read a Pose field."""
    return Pose(rot_of(r.R), vec_of(r.p))


@inlined
def inertia_of(r: Any) -> Inertia:
    """Read an Inertia field."""
    return Inertia(r.m, vec_of(r.h), sym_of(r.I))


@inlined
def articulated_of(r: Any) -> Articulated:
    """Read an Articulated field."""
    return Articulated(sym_of(r.I), rot_of(r.H), sym_of(r.M))


@inlined
def coupling_of(r: Any) -> Coupling:
    """Read a Coupling field."""
    return Coupling(rot_of(r.P), vec_of(r.p))


@inlined
def put_vec(r: Any, a: Vec) -> None:
    """Write a Vec field."""
    r.x = a.x
    r.y = a.y
    r.z = a.z


@inlined
def put_rot(r: Any, A: Rot) -> None:
    """Write a Rot field."""
    r.xx = A.xx
    r.xy = A.xy
    r.xz = A.xz
    r.yx = A.yx
    r.yy = A.yy
    r.yz = A.yz
    r.zx = A.zx
    r.zy = A.zy
    r.zz = A.zz


@inlined
def put_sym(r: Any, A: Sym) -> None:
    """Write a Sym field."""
    r.xx = A.xx
    r.xy = A.xy
    r.xz = A.xz
    r.yy = A.yy
    r.yz = A.yz
    r.zz = A.zz


@inlined
def put_motion(r: Any, m: Motion) -> None:
    """Write a Motion field."""
    put_vec(r.w, m.w)
    put_vec(r.v, m.v)


@inlined
def put_force(r: Any, f: Force) -> None:
    """Write a Force field."""
    put_vec(r.n, f.n)
    put_vec(r.f, f.f)


@inlined
def put_pose(r: Any, X: Pose) -> None:
    """Write a Pose field."""
    put_rot(r.R, X.R)
    put_vec(r.p, X.p)


@inlined
def put_inertia(r: Any, I: Inertia) -> None:
    """Write an Inertia field."""
    r.m = I.m
    put_vec(r.h, I.h)
    put_sym(r.I, I.I)


@inlined
def put_articulated(r: Any, A: Articulated) -> None:
    """Write an Articulated field."""
    put_sym(r.I, A.I)
    put_rot(r.H, A.H)
    put_sym(r.M, A.M)


@inlined
def put_coupling(r: Any, B: Coupling) -> None:
    """Write a Coupling field."""
    put_rot(r.P, B.P)
    put_vec(r.p, B.p)


# --- the border: public arrays are linear part first ----------------------------------------------------


@inlined
def public_vec(out: Any, a: Vec) -> None:
    """Write a vector to a public array (3,)."""
    out[0], out[1], out[2] = a.x, a.y, a.z


@inlined
def public_motion(out: Any, m: Motion) -> None:
    """Write a motion to a public array (6,): linear first."""
    out[0] = m.v.x
    out[1] = m.v.y
    out[2] = m.v.z
    out[3] = m.w.x
    out[4] = m.w.y
    out[5] = m.w.z


@inlined
def public_force(out: Any, f: Force) -> None:
    """Write a force to a public array (6,): linear first."""
    out[0] = f.f.x
    out[1] = f.f.y
    out[2] = f.f.z
    out[3] = f.n.x
    out[4] = f.n.y
    out[5] = f.n.z


@inlined
def public_inertia(out: Any, I: Inertia) -> None:
    """Write ten numbers to a public array (10,): m, h, and of Ī xx xy yy xz yz zz."""
    out[0] = I.m
    out[1] = I.h.x
    out[2] = I.h.y
    out[3] = I.h.z
    out[4] = I.I.xx
    out[5] = I.I.xy
    out[6] = I.I.yy
    out[7] = I.I.xz
    out[8] = I.I.yz
    out[9] = I.I.zz


@inlined
def force_from(a: Any) -> Force:
    """Read a force from a public array (6,): linear first."""
    return Force(Vec(a[3], a[4], a[5]), Vec(a[0], a[1], a[2]))


@inlined
def public_pose(out: Any, X: Pose) -> None:
    """Write a pose to a public array (4, 4)."""
    R, p = X.R, X.p
    out[0, 0], out[0, 1], out[0, 2], out[0, 3] = R.xx, R.xy, R.xz, p.x
    out[1, 0], out[1, 1], out[1, 2], out[1, 3] = R.yx, R.yy, R.yz, p.y
    out[2, 0], out[2, 1], out[2, 2], out[2, 3] = R.zx, R.zy, R.zz, p.z
    out[3, 0], out[3, 1], out[3, 2], out[3, 3] = 0.0, 0.0, 0.0, 1.0


@inlined
def pose_from(a: Any) -> Pose:
    """Read a pose from a public array (4, 4)."""
    return Pose(
        Rot(a[0, 0], a[0, 1], a[0, 2], a[1, 0], a[1, 1], a[1, 2], a[2, 0], a[2, 1], a[2, 2]),
        Vec(a[0, 3], a[1, 3], a[2, 3]),
    )
