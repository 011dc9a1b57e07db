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

from app.connections.opcua_values import NodeValue

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
        created = await self._server.nodes.objects.add_folder(self._id(folder), self._name(folder))
        self._folder = created.nodeid

    async def add(
        self,
        path: str,
        name: str,
        above: ua.NodeId | None = None,
        value: NodeValue | None = None,
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
        pattern = await self._pattern(name, value)
        link = _HAS_COMPONENT if above is not None else _ORGANIZES
        above = above or self._folder
        data = NodeData(node)
        data.attributes = pattern.attributes | {ua.AttributeIds.NodeId: _OWN_ID}
        if value is not None:
            data.attributes[ua.AttributeIds.Value] = AttributeValue(value.at(now))
        data.references = [pattern.is_a, self._upward(above, link)]
        self._space[node] = data
        downward: Any = replace(pattern.below, NodeId=node, ReferenceTypeId=link)
        self._space[above].references.append(downward)
        return node

    def remove(self, top: ua.NodeId, others: Iterable[ua.NodeId]) -> None:
        """Take away a node of the folder and all below it."""
        parameters = ua.DeleteNodesParameters()
        parameters.NodesToDelete = [
            ua.DeleteNodesItem(NodeId=node_id, DeleteTargetReferences=False)
            for node_id in (*others, top)
        ]
        self._server.iserver.node_mgt_service.delete_nodes(parameters)
        for item in parameters.NodesToDelete:
            self._upwards.pop(item.NodeId, None)
        folder = self._space[self._folder]
        folder.references = [
            reference for reference in folder.references if reference.NodeId != top
        ]

    async def _pattern(self, name: str, value: NodeValue | None) -> _Pattern:
        """Let asyncua make a node of this name and type, and take it away again."""
        key = (name, None, False) if value is None else (name, value.kind, value.is_array)
        cached = self._patterns.get(key)
        if cached is not None:
            return cached
        objects = self._server.nodes.objects
        node, display_name = ua.NodeId(ua.String("thermap/pattern"), ua.Int16(1)), self._name(name)
        if value is None:
            await objects.add_object(node, display_name)
        else:
            # The data type is taken from a value.
            await objects.add_variable(node, display_name, _example(value), value.kind)
        data, above = self._space[node], self._space[objects.nodeid]
        below = next(reference for reference in above.references if reference.NodeId == node)
        above.references.remove(below)
        del self._space[node]
        is_a = next(reference for reference in data.references if reference.IsForward)
        pattern = self._patterns[key] = _Pattern(data.attributes, is_a, below)
        return pattern

    def _upward(self, above: ua.NodeId, link: ua.NodeId) -> ua.ReferenceDescription:
        """Give how nodes refer to what they belong to; all below one share it."""
        cached = self._upwards.get(above)
        if cached is None:
            there = self._space[above]
            cached = self._upwards[above] = ua.ReferenceDescription(
                ReferenceTypeId=link,
                IsForward=False,
                NodeId=above,
                BrowseName=_said_of(there, ua.AttributeIds.BrowseName),
                DisplayName=_said_of(there, ua.AttributeIds.DisplayName),
                NodeClass=ua.NodeClass.Object,
                TypeDefinition=next(
                    reference.NodeId for reference in there.references if _is_type(reference)
                ),
            )
        return cached

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
    data_value = node.attributes[attribute].value
    return None if data_value is None or data_value.Value is None else data_value.Value.Value


def _example(value: NodeValue) -> Any:
    """Give a value of a type, from which a node takes its own."""
    example = {
        ua.VariantType.String: "",
        ua.VariantType.Boolean: False,
        ua.VariantType.DateTime: datetime(2000, 1, 1),
        ua.VariantType.UInt32: 0,
        ua.VariantType.Double: 0.0,
    }[value.kind]
    return [example] if value.is_array else example
