"""Masses, lengths and inertias of a robot as symbols, and the meaning of each symbol.

Names are those of ``exact_model.ExactRobot.values``: m_1, c_1x, I_1xx, l_1x, J_1 of the first joint's body, and g.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..calls.arguments import as_items
from ..engines.numbers.symbolic import need_sympy
from ..errors import SpatialDynError, literal
from .exact_model import ExactRobot

Expr = Any  # sympy.Expr
DIGITS = 4000  # limit of digits of a number; Python prints at most 4300
LARGEST = 10**DIGITS

PARAMETER_KINDS = {"mass": "m_", "com": "c_", "inertia": "I_", "origin": "l_", "armature": "J_", "gravity": "g"}
MEANING = {
    "m": "mass [kg] of what moves with joint",
    "c": "centre of mass [m], in its own frame, of what moves with joint",
    "I": "rotational inertia [kg m²] about its centre of mass of what moves with joint",
    "l": "origin [m], in the frame of the joint that carries it, of joint",
    "J": "rotor inertia [kg m² | kg] of joint",
}


def chosen_values(known: ExactRobot, parameters: Any) -> dict[str, Expr]:
    """{name: expression} that replaces a value of the robot; the components of gravity as g_x, g_y, g_z.

    parameters  as SymbolicManipulator takes them
    Raises SpatialDynError for other arguments or an unknown name
    """
    gravity = {x: known.values[x] for x in ("g_x", "g_y", "g_z")}
    along = [x for x, g in gravity.items() if g.num]
    nonzero = [name for name, x in known.values.items() if x.num and name not in gravity]
    nonzero += ["g"] if len(along) == 1 else along
    names = {*known.values, "g"}
    found = {}
    for name, value in _given(parameters, nonzero).items():
        if name not in names:
            raise SpatialDynError(
                f'parameters has "{name}", expected "numbers", "symbols", one of {", ".join(PARAMETER_KINDS)}, or '
                f"names such as {', '.join(nonzero[:4]) or 'g'}"
            )
        found[name] = _expression(name, value)
    if "g" in found:
        strength = found.pop("g")
        if len(along) > 1:
            raise SpatialDynError('parameters has "g", expected g_x, g_y, g_z: gravity is not along an axis')
        down = along[0] if along else "g_z"
        up = bool(along) and float(gravity[down]) > 0.0
        found[down] = strength if up else -strength
    return found


def _given(parameters: Any, nonzero: Sequence[str]) -> dict[str, Any]:
    """{name: symbol's name, expression or number} of the argument ``parameters``."""
    if isinstance(parameters, str) and parameters in ("numbers", "symbols"):
        return {name: name for name in nonzero if parameters == "symbols"}
    if isinstance(parameters, Mapping):
        return dict(parameters)
    given: dict[str, Any] = {}
    for item in as_items("parameters", parameters, str, '"numbers", "symbols", names or a mapping'):
        found = [x for x in nonzero if item in PARAMETER_KINDS and x.startswith(PARAMETER_KINDS[item])]
        given |= dict.fromkeys([item], item) if item not in PARAMETER_KINDS else {x: x for x in found}
    return given


def _expression(name: str, value: Any) -> Expr:
    """A symbol of the given name, or the expression or number itself."""
    sympy = need_sympy()
    if isinstance(value, str):
        if not value.isidentifier():
            raise SpatialDynError(f"parameters has {literal(value)} for {name}, expected the name of a symbol")
        return sympy.Symbol(value, **({"positive": True} if value[0] in "mg" else {"real": True}))
    return as_expression(f"{name} in parameters", value)


def as_expression(name: str, value: Any) -> Any:
    """A number or an expression as SymPy's, or a matrix or array of them. Raises SpatialDynError, also for text."""
    sympy = need_sympy()
    try:
        made = sympy.sympify(value, strict=True)
    except Exception as error:  # SymPy's converters of other types raise any errors
        raise SpatialDynError(f"{name} is {literal(value):.80}, expected an expression: {literal(error):.80}") from None
    if not isinstance(made, (sympy.Expr, sympy.MatrixBase, sympy.NDimArray)):
        raise SpatialDynError(f"{name} is {literal(value):.80}, expected an expression")
    if isinstance(made, sympy.Rational) and max(abs(int(made.p)), int(made.q)) >= LARGEST:
        raise SpatialDynError(f"{name} is a number of more than {DIGITS} digits, expected one that can be printed")
    return made


def meanings(
    known: ExactRobot, values: Mapping[str, Expr], joints: Sequence[str]
) -> tuple[dict[Expr, Expr | None], dict[Expr, str]]:
    """{symbol: the robot's value, None in an expression} and {symbol: meaning in words} of the chosen values.

    joints  names of the model's joints
    Raises SpatialDynError for one symbol that replaces two different values
    """
    own: dict[Expr, Expr | None] = {}
    meaning: dict[Expr, str] = {}
    for name, value in values.items():
        sign = -1 if (-value).is_Symbol else 1
        for symbol in sorted(value.free_symbols, key=str):
            number = known.ring.expression(known.values[name]) * sign if symbol == sign * value else None
            earlier = own.get(symbol)
            if earlier is not None and number is not None and earlier != number:
                raise SpatialDynError(
                    f"parameter {symbol} stands for {earlier} and for {number} ({name}), expected one value"
                )
            own[symbol] = number if earlier is None else earlier  # an expression has no value
            before = f"{meaning[symbol]}; " if symbol in meaning else ""
            meaning[symbol] = before + _words(name, joints)
    return own, meaning


def _words(name: str, joints: Sequence[str]) -> str:
    letter, _, rest = name.partition("_")
    if letter == "g":
        return "gravity [m/s²]"
    digits = rest.rstrip("xyz")
    axes = f", {rest[len(digits) :]}" if rest != digits else ""
    return f'{MEANING[letter]} "{joints[int(digits)]}"{axes}'
