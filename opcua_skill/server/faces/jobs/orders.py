"""The orders of one workstation over the job engine: taken once, begun once, followed, ended; and who is told."""

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from datetime import UTC, datetime
from typing import Any

from library.description import JobReport, JobState
from library.errors import NotFound
from library.lifecycle import FINAL_JOB_STATES
from library.records import JobOrder
from library.store import SkillLibrary
from library.values import check_text
from opcua_skill.jobs import JobEngine, Station
from opcua_skill.jobs.ids import new_job_id
from opcua_skill.jobs.motion.motion_queue import MotionQueue
from opcua_skill.security.access import caller
from opcua_skill.security.arm_lock import ArmLock
from opcua_skill.server.faces.jobs.parameters import Wanted, read
from opcua_skill.server.faces.jobs.states import NOT_BEGUN, OVER, Bit, OrderRefused, OrderState, state_of
from opcua_skill.server.faces.jobs.structures import Structures
from opcua_skill.server.features.workstation import MODE_ROLES
from opcua_skill.stack.services.calls import Refused
from opcua_skill.wire.refusals import Code

Found = tuple[JobOrder | None, JobReport | None]
Tell = Callable[[Found, tuple[OrderState, str]], Awaitable[None]]
LONGEST_ID = 128  # letters: a UUID, a URN or an order number of any planning system; the standard names no limit


class JobOrders:
    """Takes orders, begins and steers the jobs they become. ``most``: orders that may wait for their end at once."""

    def __init__(
        self,
        library: SkillLibrary,
        jobs: JobEngine,
        station: Station,
        lock: ArmLock,
        structures: Structures,
        most: int,
    ) -> None:
        self._library = library
        self._jobs = jobs
        self._station = station
        self._lock = lock
        self._structures = structures
        self.most = most
        self._one_at_a_time = asyncio.Lock()
        self._begun: dict[str, str] = {}
        self._beginning: set[str] = set()
        self._told: dict[str, tuple[OrderState, str]] = {}
        self._telling = asyncio.Lock()
        self.tell: Tell
        self.show_lists: Callable[[Sequence[Found]], Awaitable[None]]

    # What there is

    async def find(self, order_id: str) -> Found:
        """Return an order with the job it became; a job that was begun in another way goes by its job id."""
        try:
            order = await self._library.order(self._station.name, order_id)
        except NotFound:
            order = None
        job_id = order_id if order is None else order.job_id
        try:
            report = await self._library.job(job_id) if job_id else None
        except NotFound:
            report = None
        if report is not None and (report.kind != "Execution" or report.workstation != self._station.name):
            report = None
        if order is None and report is None:
            raise OrderRefused(f"{self._station.name} has no job order {order_id}", Bit.UNKNOWN_ORDER)
        return order, report

    def state(self, found: Found) -> tuple[OrderState, str]:
        """Return the state of an order that was found, and its substate."""
        return state_of(*found, held=self._station.queue.held)

    async def newest(self) -> list[Found]:
        """Return the orders that have not ended, the newest that have, and the newest jobs begun in another way."""
        orders = await self._library.orders(self._station.name, self.most)
        reports = await self._library.jobs(limit=self.most, workstation=self._station.name)
        known = {report.job_id: report for report in reports}
        found: list[Found] = []
        for order in orders:
            report = known.pop(order.job_id, None)
            found.append((order, report) if report is not None else await self.find(order.order_id))
        for report in known.values():
            if report.kind == "Execution" and await self._library.order_of_job(report.job_id) is None:
                found.append((None, report))
        return found

    # What is asked

    async def store(self, content: Any) -> None:
        """Take an order; it is not begun."""
        async with self._one_at_a_time:
            await self._taken(content)
        await self.changed(content.JobOrderID)

    async def store_and_start(self, content: Any) -> None:
        """Take an order and begin it, once; where it cannot begin it is not taken."""
        order_id = content.JobOrderID
        async with self._one_at_a_time:
            is_new = await self._taken(content)
            found = await self.find(order_id)
            if self.state(found)[0] is OrderState.NOT_ALLOWED_TO_START:
                try:
                    await self._begin(order_id, content)
                except BaseException:
                    if is_new:
                        await self._library.remove_order(self._station.name, order_id)
                    raise
        await self.changed(order_id)

    async def start(self, order_id: str) -> None:
        """Begin a stored order: it is checked completely and waits for the arm."""
        async with self._one_at_a_time:
            order = await self._own(order_id, frozenset({OrderState.NOT_ALLOWED_TO_START}))
            await self._begin(order_id, self._structures.decode(order.content))
        await self.changed(order_id)

    async def revoke_start(self, order_id: str) -> None:
        """Take an order that has not begun to move back out of the queue; it stays stored."""
        async with self._one_at_a_time:
            await self._own(order_id, frozenset({OrderState.ALLOWED_TO_START}))
            await self._taken_back(order_id)
        await self.changed(order_id)

    async def update(self, content: Any) -> None:
        """Replace an order that has not begun to move; one that was started is checked again and waits anew."""
        order_id = content.JobOrderID
        async with self._one_at_a_time:
            order = await self._own(order_id, NOT_BEGUN)
            await self._wanted(content)
            was_started = self.state(await self.find(order_id))[0] is OrderState.ALLOWED_TO_START
            if was_started:
                await self._taken_back(order_id)
            encoded = self._structures.encode(content)
            await self._library.change_order(order.workstation, order_id, content=encoded)
            if was_started:
                await self._begin(order_id, content)
        await self.changed(order_id)

    async def cancel(self, order_id: str) -> None:
        """Forget an order that has not begun to move."""
        async with self._one_at_a_time:
            order = await self._own(order_id, NOT_BEGUN)
            if self.state(await self.find(order_id))[0] is OrderState.ALLOWED_TO_START:
                await self._taken_back(order_id)
            await self._library.remove_order(order.workstation, order_id)
        await self.show()

    async def clear(self, order_id: str) -> None:
        """Forget an order that has ended; the job it became is remembered."""
        async with self._one_at_a_time:
            order = await self._own(order_id, OVER)
            await self._library.remove_order(order.workstation, order_id)
            self._begun.pop(order_id, None)
        await self.show()

    async def pause(self, order_id: str, because: str) -> None:
        """Stop on the path; the order can be resumed."""
        job_id, lane = await self._under_way(order_id)
        await lane.pause(job_id, because or f"{caller().name} paused the job order")

    async def resume(self, order_id: str) -> None:
        """Go on where the arm paused."""
        job_id, lane = await self._under_way(order_id)
        if lane is self._station.lane:
            self._lock.check(caller().session_id)
        await lane.resume(job_id)

    async def abort(self, order_id: str, because: str) -> None:
        """End an order that has not ended: what moves is stopped before the database is asked anything."""
        by, job_id = caller().name, self._begun.get(order_id, order_id)
        why = because or f"{by} aborted the job order"
        for lane in self._lanes:
            if lane.holds(job_id):
                await lane.abort(job_id, why, by=by)
                return
        async with self._one_at_a_time:
            order, report = await self.find(order_id)
            if self.state((order, report))[0] in OVER:
                raise OrderRefused(f"job order {order_id} has ended", Bit.INVALID_STATUS)
            if report is not None:
                await self._lane_of(report.job_id, report.mode).abort(report.job_id, why, by=by)
            elif order is not None:
                await self._library.change_order(order.workstation, order_id, ended="Aborted")
        await self.changed(order_id)

    async def stop(self, order_id: str, because: str) -> None:
        """Bring a run under way to rest and end its order; the queue of the arm is held, as after every stop."""
        job_id, by = self._begun.get(order_id, order_id), caller().name
        lanes = [one for one in self._lanes if one.progress_of(job_id) is not None]
        if not lanes:
            state = self.state(await self.find(order_id))[0]
            raise OrderRefused(f"job order {order_id} is {state.name}: only a run is stopped", Bit.INVALID_STATUS)
        stopping = asyncio.create_task(lanes[0].abort(job_id, because or f"{by} stopped the job order", by=by))
        if order_id in self._begun:
            await self._library.change_order(self._station.name, order_id, ended="Stopped")
        await stopping
        await self.changed(order_id)

    # How that is done

    async def _taken(self, content: Any) -> bool:
        """Store an order unless it is stored already with the same content; return whether it is new."""
        order_id = check_text(content.JobOrderID or "", "JobOrderID", LONGEST_ID)
        if not order_id:
            raise OrderRefused("JobOrderID is empty", Bit.INVALID_REQUEST)
        encoded = self._structures.encode(content)
        try:
            known = await self._library.order(self._station.name, order_id)
        except NotFound:
            known = None
        if known is not None:
            if known.content != encoded:
                raise OrderRefused(f"{order_id} is another order's id", Bit.UNABLE, Bit.OTHER_CONTENT)
            return False
        await self._wanted(content)
        order = JobOrder(workstation=self._station.name, order_id=order_id, content=encoded, actor=caller().name)
        if not await self._library.add_order(order, self.most):
            raise OrderRefused(f"{self.most} orders have not ended", Bit.UNABLE, Bit.NO_ROOM)
        return True

    async def _own(self, order_id: str, states: frozenset[OrderState]) -> JobOrder:
        """Return an order that was stored here and is in one of these states."""
        order, report = await self.find(order_id)
        state = self.state((order, report))[0]
        if order is None or state not in states:
            raise OrderRefused(f"job order {order_id} is {state.name}", Bit.INVALID_STATUS)
        return order

    async def _wanted(self, content: Any) -> tuple[Wanted, int]:
        """Return what an order asks for, and of which version (0: whichever is deployed)."""
        masters = _present(content.WorkMasterID)
        if len(masters) != 1:
            raise OrderRefused(f"{len(masters)} work masters are named: it has to be one", Bit.INVALID_REQUEST)
        master = masters[0].ID or ""
        name, _, version = master.rpartition("@")
        number = int(version) if name and version.isascii() and version.isdigit() and len(version) < 10 else 0
        name = name if number else master
        description = await self._library.description(name, number)
        places = {one.ID or "" for one in _present(content.EquipmentRequirements)} - {self._station.name}
        if places:
            told = f"{', '.join(sorted(places))}: an order's equipment is {self._station.name}"
            raise OrderRefused(told, Bit.UNABLE, Bit.INVALID_REQUEST)
        said = [*_present(masters[0].Parameters), *_present(content.JobOrderParameters)]
        given = {one.ID or "": one.Value.Value if one.Value is not None else None for one in said}
        return read(description.name, given, description), number

    async def _begin(self, order_id: str, content: Any) -> None:
        """Have the engine check and queue an order. Which job it becomes is written down before there is one."""
        wanted, version = await self._wanted(content)
        who, station = caller(), self._station
        if content.StartTime is not None and _as_utc(content.StartTime) > datetime.now(UTC):
            raise OrderRefused(f"{order_id} is to start at {content.StartTime}", Bit.UNABLE, Bit.STARTS_LATER)
        if who.role not in MODE_ROLES[wanted.mode].and_above:
            raise Refused(Code.BadUserAccessDenied, f"the role {who.role} may not run in {wanted.mode} mode")
        if wanted.mode != "simulation":
            self._lock.check(who.session_id)
        recipe_id = wanted.recipe_id or await self._library.default_recipe_id(wanted.skill_name)
        recipe = await self._library.recipe(recipe_id)
        if recipe.skill_name != wanted.skill_name:
            raise NotFound("recipe", f"{recipe_id} of {wanted.skill_name}")
        job_id = new_job_id("run")
        await self._library.change_order(station.name, order_id, job_id=job_id)
        self._begun[order_id] = job_id
        self._beginning.add(job_id)
        try:
            applied = wanted.applied(recipe, version)
            await self._jobs.execute(station.name, wanted.skill_name, applied, wanted.mode, who.name, job_id)
        except BaseException:
            self._begun.pop(order_id, None)
            await self._library.change_order(station.name, order_id, job_id="")
            raise
        finally:
            self._beginning.discard(job_id)

    async def _taken_back(self, order_id: str) -> None:
        """Take a queued job out of its lane, and forget that the order became one."""
        _, report = await self.find(order_id)
        if report is None or report.state is not JobState.QUEUED:
            raise OrderRefused(f"job order {order_id} has begun", Bit.INVALID_STATUS)
        lane = self._lane_of(report.job_id, report.mode)
        self._beginning.add(report.job_id)
        try:
            # Nothing is awaited between the question and the lane's own: a job that begins meanwhile is not stopped.
            if lane.progress_of(report.job_id) is not None:
                raise OrderRefused(f"job order {order_id} has begun", Bit.INVALID_STATUS)
            await lane.abort(report.job_id, f"{caller().name} took the job order back", by=caller().name)
            await self._library.change_order(self._station.name, order_id, job_id="")
            self._begun.pop(order_id, None)
        finally:
            self._beginning.discard(report.job_id)

    async def _under_way(self, order_id: str) -> tuple[str, MotionQueue]:
        """Return the job that an order became and the lane it is in, whatever the database says of it."""
        job_id = self._begun.get(order_id, order_id)
        for lane in self._lanes:
            if lane.holds(job_id):
                return job_id, lane
        state = self.state(await self.find(order_id))[0]
        raise OrderRefused(f"job order {order_id} is {state.name}: it has to be under way", Bit.INVALID_STATUS)

    @property
    def _lanes(self) -> tuple[MotionQueue, MotionQueue]:
        return self._station.lane, self._station.simulation

    def _lane_of(self, job_id: str, mode: str = "") -> MotionQueue:
        simulated = mode == "simulation" or self._station.simulation.holds(job_id)
        return self._station.simulation if simulated else self._station.lane

    # Who is told

    async def job_changed(self, report: JobReport) -> None:
        """Tell of a job of this workstation whose order has another state now."""
        if report.workstation != self._station.name or report.kind != "Execution" or report.job_id in self._beginning:
            return
        order = await self._library.order_of_job(report.job_id)
        if order is not None and report.state in FINAL_JOB_STATES:
            self._begun.pop(order.order_id, None)
        await self._changed((order, report), report.job_id if order is None else order.order_id)

    async def changed(self, order_id: str) -> None:
        """Tell of an order that has another state now."""
        await self._changed(await self.find(order_id), order_id)

    async def _changed(self, found: Found, order_id: str) -> None:
        async with self._telling:
            state = self.state(found)
            if self._told.get(order_id) == state:
                return
            self._told[order_id] = state
            await self.show_lists(await self.newest())
            await self.tell(found, state)

    async def show(self) -> None:
        """Show the lists anew, and tell of the orders that are in another state than was told last."""
        async with self._telling:
            listed = await self.newest()
            before, self._told = self._told, {_id_of(one): self.state(one) for one in listed}
            await self.show_lists(listed)
            for found in listed:
                state = self.state(found)
                if before.get(_id_of(found), state) != state:
                    await self.tell(found, state)


def _id_of(found: Found) -> str:
    order, report = found
    return order.order_id if order is not None else report.job_id if report is not None else ""


def _as_utc(moment: datetime) -> datetime:
    return moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment


def _present(structures: list[Any] | None) -> list[Any]:
    """Return the structures of an array that may be null, as may any of them."""
    return [one for one in structures or [] if one is not None]
