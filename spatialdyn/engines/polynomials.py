"""Constants of sin and cos in the native code of kernels and programs.

Method: n = rint(x 2/π) by adding and subtracting 1.5 · 2⁵²; r = x - n π/2 with π/2 in three parts (Cody, Waite); then
the minimax polynomials of fdlibm, sin r = r + r³ SINE(r²) and cos r = 1 - r²/2 + r⁴ COSINE(r²).
"""

MAGIC = {"double": 6755399441055744.0, "float": 12582912.0}
HALF_PI: dict[tuple[str, bool], tuple[float, ...]] = {
    # with fma: parts of full precision; without: parts whose product with n is exact
    ("double", True): (1.5707963267948966, 6.123233995736766e-17, -1.4973849048591833e-33),
    ("double", False): (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21),
    ("float", True): (1.5707963705062866, -4.371138828673793e-08, -1.7151245100058819e-15),
    ("float", False): (
        1.5703125,
        0.0004825592041015625,
        1.2665987014770508e-06,
        9.89530235528946e-10,
        2.5579538487363607e-12,
        5.390302953474238e-15,
    ),
}
SINE = {
    "double": (
        -1.66666666666666324348e-01,
        8.33333333332248946124e-03,
        -1.98412698298579493134e-04,
        2.75573137070700676789e-06,
        -2.50507602534068634195e-08,
        1.58969099521155010221e-10,
    ),
    "float": (-1 / 6, 1 / 120, -1 / 5040, 1 / 362880),  # one term more than float32 resolves; without it 1.6 ulp
}
COSINE = {
    "double": (
        4.16666666666666019037e-02,
        -1.38888888888741095749e-03,
        2.48015872894767294178e-05,
        -2.75573143513906633035e-07,
        2.08757232129817482790e-09,
        -1.13596475577881948265e-11,
    ),
    "float": (4.166664568298827e-2, -1.388731625493765e-3, 2.443315711809948e-5),
}
MAX_ANGLE = 1e5  # if the root of the sum of squares of a sample's angles is larger, the C library computes sin and cos
