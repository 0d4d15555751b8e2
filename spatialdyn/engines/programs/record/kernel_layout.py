"""The layout of a kernel: what a compiled program reads, writes and checks."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Float32Range:
    """The range of norms (roots of sums of squares) in which a program's underflow is below its rounding.

    most     largest norm of all inputs together
    least    least norm of each output array, unless all driving inputs are 0
    driving  indices of the input arrays that drive the result: if they are 0, the result may be 0; None if a nonzero
             constant drives the result
    """

    most: float
    least: float
    driving: tuple[int, ...] | None


@dataclass(frozen=True)
class KernelLayout:
    """What a kernel reads and writes, and the checks of a valid sample.

    inputs   columns of each input array, in the program's order of inputs
    outputs  for each output array, the indices of its columns in the program's outputs
    units    groups of inputs whose squares must sum to 1
    pivots   (index in the program's outputs, value that it must exceed)
    norms    groups of indices in the program's outputs whose squares must sum to 1
    range    norms that inputs and outputs must have, if any
    bounds   how many of the last output arrays are bounds, which may be infinite: they are not checked
    common   indices of input arrays with one row for all samples, which are read like constants; the caller checks that
             they are finite
    """

    inputs: tuple[int, ...]
    outputs: tuple[tuple[int, ...], ...]
    units: tuple[tuple[int, ...], ...] = ()
    pivots: tuple[tuple[int, float], ...] = ()
    norms: tuple[tuple[int, ...], ...] = ()
    range: Float32Range | None = None
    bounds: int = 0
    common: tuple[int, ...] = ()

    @property
    def checked(self) -> tuple[tuple[int, ...], ...]:
        """The output arrays whose numbers must be finite, and in range."""
        return self.outputs[: len(self.outputs) - self.bounds]
