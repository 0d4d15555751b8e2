"""M, C and g in closed form: the arms of sections 8.1 and 16 of the chapter, in masses and lengths.

Learn    SymbolicManipulator runs the recursions on symbols: any mass, length or inertia is a symbol or an expression.
Look at  M[3, 3] = l_3² m_3/3 of the spatial arm. The chapter's script prints l_3² m_3/4, for it leaves out the energy
         of rotation about the centres of mass, though its table gives the links I = m l²/12.
Needs    pip install sympy
"""

from __future__ import annotations

from typing import Any

import spatialdyn as sd
from spatialdyn.examples.gallery import need, start


def main() -> dict[str, Any]:
    """Print the matrices of both arms; returns them, with what rotation adds to M of the second."""
    sympy = need("sympy", "symbolic")
    planar = sd.SymbolicManipulator(  # 2R: the first mass sits where the second joint is, so both are l_1 away
        sd.load_urdf("two_link"), {"m_1": "m_1", "m_2": "m_2", "l_2x": "l_1", "c_1x": "l_1", "c_2x": "l_2", "g": "g"}
    )
    print("2R, section 8.1: point masses at the ends of the links\n")
    for quantity in ("M", "C", "g"):
        print(planar.text(quantity))

    m, l = sympy.symbols("m_1:4", positive=True), sympy.symbols("l_1:4", positive=True)

    def spatial(rotation: int) -> sd.SymbolicManipulator:
        """3R, axes z y y: rods with their centres halfway, with or without their inertia about it."""
        values: dict[str, Any] = {"g": "g", "l_2z": l[0], "l_3z": l[1]}
        for k in (1, 2, 3):
            across = rotation * m[k - 1] * l[k - 1] ** 2 / 12
            values |= {f"m_{k}": m[k - 1], f"c_{k}z": l[k - 1] / 2}
            values |= {f"I_{k}xx": across, f"I_{k}yy": across, f"I_{k}zz": 0}
        return sd.SymbolicManipulator(sd.load_urdf("three_link"), values)

    rods, points = spatial(1), spatial(0)
    print("3R, section 16: uniform rods\n")
    for quantity in ("M", "g"):
        print(rods.text(quantity))
    terms = sum(len(sympy.Add.make_args(sympy.expand(x))) for x in rods.C())
    print(f"C has {terms} terms: print(rods.text('C'))\n")
    missing = rods.simplify(rods.M() - points.M())
    print(f"what rotation adds to M, which the chapter's script leaves out:\n\n{rods.text(missing)}")
    return {"planar": planar, "rods": rods, "points": points, "missing": missing}


if __name__ == "__main__":
    start(main)
