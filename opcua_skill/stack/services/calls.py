"""Method calls: declared once, checked before the handler runs, answered with exact status codes."""

import asyncio
import functools
import logging
import secrets
from collections.abc import Awaitable, Callable, Mapping
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Any

from asyncua import ua
from asyncua.common.node import Node
from asyncua.server.address_space import AddressSpace, MethodService
from asyncua.ua.attribute_ids import AttributeIds
from asyncua.ua.object_ids import ObjectIds as Ids
from asyncua.ua.status_codes import StatusCodes as Codes

from opcua_skill.security.access import Caller, Role, audit_entry_id, caller
from opcua_skill.stack.address_space.values import node_id, status, status_name
from opcua_skill.stack.limits import Limits
from opcua_skill.stack.services.arguments import ArgumentCheck, compile_check, output_variant
from opcua_skill.stack.services.operations import attempted, refused
from opcua_skill.stack.services.reading import weight_of
from opcua_skill.stack.transport.budgets import Budget

log = logging.getLogger(__name__)
LONGEST_REASON = 1_000
REFUSALS_AT_ONCE, REFUSALS_A_SECOND = 100, 1.0


@dataclass(frozen=True, slots=True)
class Argument:
    """One argument of a method. ``rank`` is the OPC UA ValueRank: -1 a scalar, 1 an array.

    The value of a ``secret`` argument never reaches a call record, an event or the log.
    """

    name: str
    data_type: ua.NodeId
    rank: int = -1
    description: str = ""
    secret: bool = False


@dataclass(frozen=True, slots=True)
class MethodSpec:
    """One method: what it takes and gives, who may call it, and the coroutine behind it.

    The handler gets one Python value for each input and returns a tuple with one for each output. A null String or
    ByteString arrives as an empty one, a null array as an empty list, a structure as an instance of its class.
    ``changes`` says that a call changes something, so that every call is recorded, not only a refused one; such a
    call also runs to its end when the client goes away. ``time_limit`` is in seconds. ``urgent``: it stops something,
    and its answer does not wait for the record of the call.
    """

    name: str
    inputs: tuple[Argument, ...]
    outputs: tuple[Argument, ...]
    handler: Callable[..., Awaitable[tuple[Any, ...]]]
    roles: frozenset[Role]
    changes: bool
    description: str = ""
    time_limit: float = 10.0
    urgent: bool = False


class Refused(Exception):
    """Raised by a handler to refuse a call: the status code, a sentence of reason, which arguments are at fault."""

    def __init__(self, code: int, reason: str, *, arguments: Mapping[str, int] | None = None) -> None:
        super().__init__(reason)
        self.code = int(code)
        self.reason = reason
        self.arguments = dict(arguments or {})


@dataclass(frozen=True, slots=True)
class CallRecord:
    """What was called, by whom, with what, and how it ended: the material of the audit trail.

    ``arguments`` are (name, value) pairs as decoded; secret ones read "***". When the call did not even have the
    right number of arguments, they are named by position. ``client_audit_entry_id`` is what the client calls this
    request in its own records, empty if it did not say.
    """

    caller: Caller
    object_id: ua.NodeId
    method_id: ua.NodeId
    method_name: str
    arguments: tuple[tuple[str, Any], ...]
    status: int
    reason: str
    client_audit_entry_id: str = ""

    @property
    def status_name(self) -> str:
        """Return the status code in words, such as BadUserAccessDenied."""
        return status_name(self.status)


OnCall = Callable[[CallRecord], Awaitable[None]]
_object: ContextVar[ua.NodeId] = ContextVar("opcua_skill_called_object")


def called_object() -> ua.NodeId:
    """Return the object on which the method that runs now was called."""
    return _object.get()


@dataclass(slots=True)
class _Method:
    spec: MethodSpec
    checks: tuple[ArgumentCheck, ...] = field(default=())


class CheckedMethods(MethodService):
    """The method service with all checks of OPC 10000-4, 5.12 before the handler, and exact codes after it."""

    def __init__(self, aspace: AddressSpace) -> None:
        super().__init__(aspace)
        self._pool.shutdown()
        self.largest_answer = Limits().largest_answer
        self.on_call: OnCall | None = None
        self.on_unrecorded: OnCall | None = None
        self.refusals = Budget(REFUSALS_AT_ONCE, REFUSALS_A_SECOND)
        self._methods: dict[ua.NodeId, _Method] = {}
        self._unfinished: set[asyncio.Task[Any]] = set()

    def register(self, method_id: ua.NodeId, spec: MethodSpec) -> None:
        """Bind a specification to a method node that exists."""
        self._methods[method_id] = _Method(spec)
        self._aspace[method_id].call = spec.handler

    def spec(self, method_id: ua.NodeId) -> MethodSpec | None:
        """Return the specification of a method node, or None if it is not one of ours."""
        method = self._methods.get(method_id)
        return method.spec if method else None

    def executable_by(self, method_id: ua.NodeId, role: Role) -> bool:
        """Return whether a session of this role may call the method: the truth behind UserExecutable."""
        method = self._methods.get(method_id)
        return method is not None and role in method.spec.roles

    async def drain(self, seconds: float) -> None:
        """Wait for calls that go on after their client went away; cancel those that take longer."""
        if self._unfinished:
            _, late = await asyncio.wait(self._unfinished, timeout=seconds)
            for task in late:
                task.cancel()
            await asyncio.gather(*late, return_exceptions=True)

    async def call(self, methods: list[ua.CallMethodRequest]) -> list[ua.CallMethodResult]:
        """Call methods one after another; each has a result of its own."""
        not_called = functools.partial(refused, ua.CallMethodResult)
        return [await attempted(lambda method=method: self._call(method), not_called, "Call") for method in methods]

    async def _call(self, method: ua.CallMethodRequest) -> ua.CallMethodResult:
        given = method.InputArguments or []
        try:
            method_id = self._resolve(method.ObjectId, method.MethodId)
            found = self._methods[method_id]
        except Refused as refusal:
            return await self._refuse(method.ObjectId, method.MethodId, None, given, refusal)
        spec = found.spec
        try:
            values = self._admit(found, method_id, given)
        except Refused as refusal:
            return await self._refuse(method.ObjectId, method_id, spec, given, refusal)
        if not spec.changes:
            return await self._run(method.ObjectId, method_id, spec, given, values)
        task = asyncio.create_task(self._run(method.ObjectId, method_id, spec, given, values))
        self._unfinished.add(task)
        task.add_done_callback(self._unfinished.discard)
        return await asyncio.shield(task)

    def _resolve(self, object_id: ua.NodeId, method_id: ua.NodeId) -> ua.NodeId:
        """Return the method node of the object: the one named, or the object's own if its type's was named."""
        if object_id not in self._aspace:
            raise Refused(Codes.BadNodeIdUnknown, f"there is no object {object_id.to_string()}")
        if method_id not in self._aspace:
            raise Refused(Codes.BadMethodInvalid, f"there is no method {method_id.to_string()}")
        own = [
            ref for ref in self._aspace[object_id].references if ref.IsForward and ref.NodeClass == ua.NodeClass.Method
        ]
        if not any(ref.NodeId == method_id for ref in own):
            name = self._aspace[method_id].attributes[AttributeIds.BrowseName].value
            wanted = name.Value.Value if name and name.Value else None
            same = [ref.NodeId for ref in own if ref.BrowseName == wanted]
            if not (same and self._declared_by_type(object_id, method_id)):
                reason = f"{method_id.to_string()} is not a method of {object_id.to_string()}"
                raise Refused(Codes.BadMethodInvalid, reason)
            method_id = same[0]
        if method_id not in self._methods:
            raise Refused(Codes.BadNotImplemented, f"{method_id.to_string()} is declared but not implemented here")
        return method_id

    def _declared_by_type(self, object_id: ua.NodeId, method_id: ua.NodeId) -> bool:
        follow, node = Ids.HasTypeDefinition, self._aspace.get(object_id)
        while node is not None:
            if any(ref.NodeId == method_id and ref.IsForward for ref in node.references):
                return True
            forward = follow == Ids.HasTypeDefinition
            link = node_id(follow)
            above = [r.NodeId for r in node.references if r.ReferenceTypeId == link and r.IsForward == forward]
            node, follow = (self._aspace.get(above[0]) if above else None), Ids.HasSubtype
        return False

    def _admit(self, found: _Method, method_id: ua.NodeId, given: list[ua.Variant]) -> list[Any]:
        """Return the Python values of the arguments, or refuse."""
        spec, who = found.spec, caller()
        if who.role not in spec.roles:
            raise Refused(Codes.BadUserAccessDenied, f"the role {who.role} may not call {spec.name}")
        executable = self._aspace.read_attribute_value(method_id, AttributeIds.Executable)
        if executable.Value is not None and executable.Value.Value is False:
            raise Refused(Codes.BadNotExecutable, f"{spec.name} cannot be called now")
        if len(given) != len(spec.inputs):
            code = Codes.BadArgumentsMissing if len(given) < len(spec.inputs) else Codes.BadTooManyArguments
            raise Refused(code, f"{spec.name} takes {len(spec.inputs)} arguments, {len(given)} were given")
        if len(found.checks) != len(spec.inputs):
            found.checks = tuple(compile_check(self._aspace, a.data_type, a.rank) for a in spec.inputs)
        values, wrong = [], {}
        for argument, check, variant in zip(spec.inputs, found.checks, given, strict=True):
            good, value = check(variant)
            values.append(value)
            if not good:
                wrong[argument.name] = Codes.BadTypeMismatch
        if wrong:
            raise Refused(
                Codes.BadInvalidArgument, f"{', '.join(wrong)} of {spec.name} has the wrong type", arguments=wrong
            )
        return values

    async def _run(
        self, object_id: ua.NodeId, method_id: ua.NodeId, spec: MethodSpec, given: list[ua.Variant], values: list[Any]
    ) -> ua.CallMethodResult:
        token = _object.set(object_id)
        try:
            async with asyncio.timeout(spec.time_limit):
                outputs = await spec.handler(*values)
            size = sum(weight_of(value) for value in outputs)
            if size > self.largest_answer:
                reason = f"the answer would have {size} bytes, {self.largest_answer} are allowed: ask for less at once"
                raise Refused(Codes.BadResponseTooLarge, reason)
            result = ua.CallMethodResult()
            result.InputArgumentResults = [status() for _ in given]
            result.OutputArguments = [
                output_variant(self._aspace, argument.data_type, argument.rank, value)
                for argument, value in zip(spec.outputs, outputs, strict=True)
            ]
        except Refused as refusal:
            return await self._refuse(object_id, method_id, spec, given, refusal)
        except TimeoutError:
            refusal = Refused(Codes.BadTimeout, f"{spec.name} took longer than {spec.time_limit:g} s")
            return await self._refuse(object_id, method_id, spec, given, refusal)
        except Exception:
            fault = secrets.token_hex(4)
            log.exception("fault %s in %s", fault, spec.name)
            refusal = Refused(Codes.BadInternalError, f"fault inside, found in the log as {fault}")
            return await self._refuse(object_id, method_id, spec, given, refusal)
        finally:
            _object.reset(token)
        if spec.changes:
            await self._record(object_id, method_id, spec, given, Codes.Good, "")
        return result

    async def _refuse(
        self,
        object_id: ua.NodeId,
        method_id: ua.NodeId,
        spec: MethodSpec | None,
        given: list[ua.Variant],
        refusal: Refused,
    ) -> ua.CallMethodResult:
        result = ua.CallMethodResult()
        result.StatusCode = status(refusal.code)
        if spec is not None and len(given) == len(spec.inputs):
            result.InputArgumentResults = [
                status(refusal.arguments.get(argument.name, Codes.Good)) for argument in spec.inputs
            ]
        await self._record(object_id, method_id, spec, given, refusal.code, refusal.reason)
        return result

    async def _record(
        self,
        object_id: ua.NodeId,
        method_id: ua.NodeId,
        spec: MethodSpec | None,
        given: list[ua.Variant],
        status: int,
        reason: str,
    ) -> None:
        """Tell the hook and the log. A hook that fails cannot undo the call, so it is logged and the answer stands.

        Of one user's refusals so many are recorded a second; the others are counted, and told to who listens.
        """
        named = spec.inputs if spec is not None and len(spec.inputs) == len(given) else ()
        arguments = (
            tuple((a.name, "***" if a.secret else v.Value) for a, v in zip(named, given, strict=True))
            if named
            else tuple((str(place), "?") for place in range(len(given)))
        )
        name = spec.name if spec is not None else method_id.to_string()[:LONGEST_REASON]
        reason = reason if len(reason) <= LONGEST_REASON else f"{reason[:LONGEST_REASON]}…"
        record = CallRecord(caller(), object_id, method_id, name, arguments, status, reason, audit_entry_id.get())
        who, hook = record.caller, self.on_call
        fault = status == Codes.BadInternalError
        if reason and not fault and not self.refusals.admits(who.name or who.peer):
            hook = self.on_unrecorded
        elif reason:
            log.warning(
                "%s refused to %s (%s, %s): %s: %s", name, who.name, who.role, who.peer, record.status_name, reason
            )
        else:
            log.info("%s called by %s (%s, %s)", name, who.name, who.role, who.peer)
        if hook is None:
            return
        if spec is not None and spec.urgent:
            task = asyncio.create_task(self._told(hook, record))
            self._unfinished.add(task)
            task.add_done_callback(self._unfinished.discard)
        else:
            await self._told(hook, record)

    @staticmethod
    async def _told(hook: OnCall, record: CallRecord) -> None:
        try:
            await hook(record)
        except Exception:
            log.exception("fault %s: a call of %s was not recorded", secrets.token_hex(4), record.method_name)


async def add_method(
    server: Any, parent_node: Node | ua.NodeId, spec: MethodSpec, node_id: ua.NodeId, browse_name: ua.QualifiedName
) -> Node:
    """Add a method node below an object (or a type) and bind the specification to it.

    ``server`` is a SkillServer. The node gets real argument descriptions, names, ranks and dimensions, which strict
    clients need, and its UserExecutable is told to each session by its role.
    """
    parent = parent_node if isinstance(parent_node, Node) else server.get_node(parent_node)
    inputs = [ua_argument(argument) for argument in spec.inputs]
    outputs = [ua_argument(argument) for argument in spec.outputs]
    node = await parent.add_method(node_id, browse_name, spec.handler, inputs, outputs)
    if spec.description:
        await node.write_attribute(
            AttributeIds.Description, ua.DataValue(ua.Variant(ua.LocalizedText(spec.description)))
        )
    server.iserver.method_service.register(node.nodeid, spec)
    return node


def ua_argument(argument: Argument) -> ua.Argument:
    """Return the description of an argument as clients read it."""
    dimensions = [ua.UInt32(0)] * argument.rank if argument.rank > 0 else []
    return ua.Argument(
        Name=argument.name,
        DataType=argument.data_type,
        ValueRank=ua.Int32(argument.rank),
        ArrayDimensions=dimensions,
        Description=ua.LocalizedText(argument.description),
    )
