"""Which errors of a machine have to be measured, over HTTP."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

from pydantic import Field

from app.api.schemas.base import Schema

if TYPE_CHECKING:
    from app.geometry.nonrigid_presets import NonrigidPreset
    from app.services.geometry import NeededComponents


class PresetAnswer(Schema):
    """A kind of machine that is not rigid (C. Wang, 8.19–8.54)."""

    name: str = Field(description="How it is asked for", examples=["large-gantry"])
    configuration: str = Field(description="The chain that the source gives it", examples=["XYFZ"])
    equations: str = Field(description="Where it is printed", examples=["8.37–8.54"])
    reason: str = Field(description="What bends it")
    slopes: list[str] = Field(
        description="The nonrigid slopes that are not negligible on it", examples=[["EXY^x"]]
    )

    @classmethod
    def of(cls, preset: NonrigidPreset) -> Self:
        """Show a preset."""
        return cls(
            name=preset.name,
            configuration=preset.configuration,
            equations=preset.equations,
            reason=preset.reason,
            slopes=list(preset.slopes),
        )


class NeededComponent(Schema):
    """One error that the volumetric error of the machine consists of."""

    component: str = Field(description="ISO 230-1 code", examples=["EXY^x"])
    chapter: str = Field(description="The chapter's notation", examples=["D_x^x(y)"])
    kind: str = Field(description="Its group", examples=["nonrigid slope"])
    unit: str = Field(description="Unit of its values", examples=["µm/m"])
    in_model: bool = Field(description="Whether the active model's maps have it")


class NeededAnswer(Schema):
    """Which errors have to be measured, and which of them the active model lacks."""

    machine: str = Field(description="Machine", examples=["mcfv5050"])
    configuration: str = Field(description="Its kinematic chain", examples=["XYFZ"])
    preset: PresetAnswer | None = Field(
        description="The kind of machine that was asked for; null for a rigid one"
    )
    components: list[NeededComponent] = Field(description="What has to be measured, in order")
    missing: list[str] = Field(
        description="Of these, what no map of the active model has", examples=[["EXY^x"]]
    )
    warnings: list[str] = Field(description="What to know beside it")

    @classmethod
    def of(cls, needed: NeededComponents) -> Self:
        """Show what was found."""
        return cls(
            machine=needed.machine.id,
            configuration=needed.machine.chain.text,
            preset=PresetAnswer.of(needed.preset) if needed.preset else None,
            components=[
                NeededComponent(
                    component=component.code,
                    chapter=component.chapter,
                    kind=component.kind,
                    unit=component.unit.symbol,
                    in_model=component.code in needed.in_model,
                )
                for component in needed.needed
            ],
            missing=needed.missing,
            warnings=list(needed.warnings),
        )
