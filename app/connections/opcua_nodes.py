"""Nodes of an OPC UA server by the ten thousand, put straight into its address space.

asyncua takes a millisecond and 8 KB for each node, looks at all beside one that is added, and at
all that there are for each that is deleted. Here it makes the first of each name and type, and
what the others say alike they share; so it is still asyncua that says what a node consists of.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any, Final, TypeAlias

from asyncua import Server, ua
from asyncua.server.address_space import AddressSpace, AttributeValue, NodeData

from app.connections.opcua_values import Said

_Attributes: TypeAlias = dict[ua.AttributeIds, AttributeValue]

_ORGANIZES: Final = ua.NodeId(ua.Int32(ua.ObjectIds.Organizes))
_HAS_COMPONENT: Final = ua.NodeId(ua.Int32(ua.ObjectIds.HasComponent))


@dataclass(frozen=True, slots=True)
class _Pattern:
    """What nodes of one name and type say alike, and how one above refers to them."""

    attributes: _Attributes
    is_a: ua.ReferenceDescription
    below: ua.ReferenceDescription


class Nodes:
    """The nodes below one folder of a server; `begin` first.

    Parameters
    ----------
    index
        Of the namespace that they are in.
    """

    def __init__(self, server: Server, index: int) -> None:
        self._server = server
        self._index = index
        self._space: AddressSpace = server.iserver.aspace
        self._folder = ua.NodeId()
        self._patterns: dict[tuple[str, ua.VariantType | None, bool], _Pattern] = {}
        self._upwards: dict[ua.NodeId, ua.ReferenceDescription] = {}

    async def begin(self, folder: str) -> None:
        """Make the folder, below `Objects`."""
        made = await self._server.nodes.objects.add_folder(self._id(folder), self._name(folder))
        self._folder = made.nodeid

    async def add(
        self,
        path: str,
        name: str,
        above: ua.NodeId | None = None,
        said: Said | None = None,
        *,
        now: datetime,
    ) -> ua.NodeId:
        """Add a variable that says something, or an object.

        Parameters
        ----------
        path
            The node's id.

        Raises
        ------
        UaError
            If there is a node of this id.
        """
        node = self._id(path)
        if node in self._space:
            raise ua.UaError(f"expected an id that no node has, got {path!r}")
        pattern = await self._pattern(name, said)
        link = _HAS_COMPONENT if above is not None else _ORGANIZES
        above = above or self._folder
        made = NodeData(node)
        made.attributes = pattern.attributes | {ua.AttributeIds.NodeId: _OWN_ID}
        if said is not None:
            made.attributes[ua.AttributeIds.Value] = AttributeValue(said.at(now))
        made.references = [pattern.is_a, self._upward(above, link)]
        self._space[node] = made
        downward: Any = replace(pattern.below, NodeId=node, ReferenceTypeId=link)
        self._space[above].references.append(downward)
        return node

    def remove(self, top: ua.NodeId, others: Iterable[ua.NodeId]) -> None:
        """Take away a node of the folder and all below it."""
        asked = ua.DeleteNodesParameters()
        asked.NodesToDelete = [
            ua.DeleteNodesItem(NodeId=one, DeleteTargetReferences=False) for one in (*others, top)
        ]
        self._server.iserver.node_mgt_service.delete_nodes(asked)
        for one in asked.NodesToDelete:
            self._upwards.pop(one.NodeId, None)
        folder = self._space[self._folder]
        folder.references = [one for one in folder.references if one.NodeId != top]

    async def _pattern(self, name: str, said: Said | None) -> _Pattern:
        """Let asyncua make a node of this name and type, and take it away again."""
        key = (name, None, False) if said is None else (name, said.kind, said.is_array)
        known = self._patterns.get(key)
        if known is not None:
            return known
        objects = self._server.nodes.objects
        node, shown = ua.NodeId(ua.String("thermap/pattern"), ua.Int16(1)), self._name(name)
        if said is None:
            await objects.add_object(node, shown)
        else:
            # The data type is taken from a value.
            await objects.add_variable(node, shown, _example(said), said.kind)
        found, above = self._space[node], self._space[objects.nodeid]
        below = next(one for one in above.references if one.NodeId == node)
        above.references.remove(below)
        del self._space[node]
        is_a = next(one for one in found.references if one.IsForward)
        made = self._patterns[key] = _Pattern(found.attributes, is_a, below)
        return made

    def _upward(self, above: ua.NodeId, link: ua.NodeId) -> ua.ReferenceDescription:
        """Give how nodes refer to what they belong to; all below one share it."""
        known = self._upwards.get(above)
        if known is None:
            there = self._space[above]
            known = self._upwards[above] = ua.ReferenceDescription(
                ReferenceTypeId=link,
                IsForward=False,
                NodeId=above,
                BrowseName=_said_of(there, ua.AttributeIds.BrowseName),
                DisplayName=_said_of(there, ua.AttributeIds.DisplayName),
                NodeClass=ua.NodeClass.Object,
                TypeDefinition=next(one.NodeId for one in there.references if _is_type(one)),
            )
        return known

    def _id(self, path: str) -> ua.NodeId:
        return ua.NodeId(ua.String(path), ua.Int16(self._index))

    def _name(self, name: str) -> ua.QualifiedName:
        return ua.QualifiedName(name, self._index)


def _say_id(node: ua.NodeId, _attribute: ua.AttributeIds) -> ua.DataValue:
    return ua.DataValue(ua.Variant(node, ua.VariantType.NodeId))


_OWN_ID: Final = AttributeValue(ua.DataValue())
"""The one attribute that no two nodes say alike, made when somebody asks."""
_OWN_ID.value_callback = _say_id


def _is_type(reference: ua.ReferenceDescription) -> bool:
    is_forward = bool(reference.IsForward)
    return is_forward and reference.ReferenceTypeId.Identifier == ua.ObjectIds.HasTypeDefinition


def _said_of(node: NodeData, attribute: ua.AttributeIds) -> Any:
    found = node.attributes[attribute].value
    return None if found is None or found.Value is None else found.Value.Value


def _example(said: Said) -> Any:
    """Give a value of a type, from which a node takes its own."""
    one = {
        ua.VariantType.String: "",
        ua.VariantType.Boolean: False,
        ua.VariantType.DateTime: datetime(2000, 1, 1),
        ua.VariantType.UInt32: 0,
        ua.VariantType.Double: 0.0,
    }[said.kind]
    return [one] if said.is_array else one
