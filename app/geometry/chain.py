"""The kinematic chain of a machine: which axes carry the workpiece and which the tool.

In `XYFZ` the letters before F move the workpiece, those after it the tool, each
from the base outward (C. Wang, section 8.1.3). F is the fixed base.
"""

from __future__ import annotations

from dataclasses import dataclass

from app.errors import InvalidContent
from app.geometry.components import LINEAR_LETTERS


@dataclass(frozen=True, slots=True)
class Chain:
    """The order of the linear axes around the base.

    Parameters
    ----------
    workpiece
        Axes that move the workpiece, lower case, from the base outward.
    tool
        Axes that move the tool, lower case, from the base outward.
    """

    workpiece: tuple[str, ...]
    tool: tuple[str, ...]

    @classmethod
    def parse(cls, text: str) -> Chain:
        """Read a chain such as `XYFZ`; a lathe with two axes is `FZX`.

        Raises
        ------
        InvalidContent
            If the text is not one F and one to three different letters of X, Y, Z.

        Examples
        --------
        >>> Chain.parse("XYFZ")
        Chain(workpiece=('x', 'y'), tool=('z',))
        """
        letters = text.lower()
        axes = [letter for letter in letters if letter != "f"]
        if (
            letters.count("f") != 1
            or not axes
            or len(set(axes)) != len(axes)
            or not set(axes) <= set(LINEAR_LETTERS)
        ):
            rotary = not set(letters).isdisjoint("abc")
            hint = ": rotary axes do not belong in it" if rotary else ""
            raise InvalidContent.of_field(
                "configuration",
                "expected the axes X, Y, Z in the order of the machine around one F, such as "
                f"FXYZ, XFYZ, XYFZ, XYZF or FYXZ (two axes: FZX), got {text!r}{hint}",
            )
        before, _, after = letters.partition("f")
        return cls(tuple(before), tuple(after))

    @property
    def text(self) -> str:
        """The chain as it is written, `XYFZ`."""
        return f"{''.join(self.workpiece)}f{''.join(self.tool)}".upper()

    @property
    def axes(self) -> tuple[str, ...]:
        """All linear axes, workpiece side first."""
        return self.workpiece + self.tool

    def acts_on(self, axis: str) -> frozenset[str]:
        """Name the coordinates that a rotation of an axis acts on as lever arms.

        On the tool's side these are the offsets of the axes after it; on the
        workpiece's side its own, those of the workpiece-side axes before it and
        all tool-side axes. The tool offset comes on top for every axis. The rule
        gives 8.68–8.82 term by term, the four configurations and any other order.

        >>> sorted(Chain.parse("XYFZ").acts_on("y"))
        ['x', 'y', 'z']
        >>> sorted(Chain.parse("FXYZ").acts_on("z"))
        []
        """
        # Seen from the workpiece the way to the tool goes through the workpiece's axes from the
        # outermost inward, over the base, and out through the tool's axes. A rotation acts on what
        # comes after it on this way. On the workpiece's side an axis turns between the workpiece
        # and its own travel, which is thus among it (RI(y) Y in 8.65); on the tool's side it turns
        # behind its travel (X in 8.63).
        if axis in self.tool:
            return frozenset(self.tool[self.tool.index(axis) + 1 :])
        return frozenset(self.workpiece[: self.workpiece.index(axis) + 1] + self.tool)
