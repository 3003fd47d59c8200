"""`record`: a gateway from a tracker, or from files, to the recorder of a workstation."""

import asyncio
import contextlib
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import typer
from rich.live import Live
from rich.text import Text

from models.demonstration import Demonstration
from opcua_skill.client import Recorder, Skill, SkillClient
from opcua_skill.commands.options.client import DEFAULT_SERVER, Json, On, Server, User, with_client
from opcua_skill.commands.skills import (
    Option,
    SemanticType,
    known_type,
    learning_options,
    made_of_it,
    say_learned,
    summary,
)
from opcua_skill.commands.terminal.errors import Fault
from opcua_skill.commands.terminal.output import counted, millimetres, note, notes, print_json, say, show_table, table
from opcua_skill.commands.terminal.reading import (
    Marker,
    OnePlane,
    Placing,
    Topic,
    ToPlate,
    Unit,
    UpAxis,
    choices_of,
    read_files,
)
from opcua_skill.gateway import (
    STOPPED,
    Ended,
    Losses,
    Progress,
    ReplaySource,
    Source,
    SourceFault,
    UdpSource,
    pass_on,
    tracker_at,
)

LOOPBACK = "127.0.0.1"
Interrupted = Literal["ask", "finish", "discard"]


def record(
    on: On,
    files: Annotated[
        list[Path] | None, typer.Option("--from", metavar="FILE", exists=True, help="file to replay, repeatable")
    ] = None,
    udp: Annotated[
        int | None, typer.Option("--udp", metavar="PORT", min=0, max=65535, help="port to listen on; 0: a free one")
    ] = None,
    tracker: Annotated[
        str, typer.Option("--tracker", metavar="NAME[:ADDRESS]", help="installed tracker to record from")
    ] = "",
    bind: Annotated[str, typer.Option("--bind", metavar="ADDRESS", help="address to listen on")] = LOOPBACK,
    sender: Annotated[
        str, typer.Option("--sender", metavar="ADDRESS", help="address of the tracker: nobody else is listened to")
    ] = "",
    operator: Annotated[str, typer.Option("--operator", help="who demonstrates; empty: who signs in")] = "",
    speed: Annotated[float, typer.Option("--speed", min=0.0, help="of a replay; 0: as fast as it goes")] = 1.0,
    silence: Annotated[
        float, typer.Option("--silence", min=0.1, help="seconds without a sample that end a recording")
    ] = 5.0,
    wait: Annotated[float, typer.Option("--wait", min=0.1, help="seconds to wait for the first sample")] = 60.0,
    on_interrupt: Annotated[
        str, typer.Option("--on-interrupt", help="what Ctrl-C does: ask, finish or discard; no terminal: finish")
    ] = "ask",
    learn: Annotated[str, typer.Option("--learn", metavar="SKILL", help="skill to learn from the recording")] = "",
    semantic_type: SemanticType = "",
    option: Option = None,
    save: Annotated[
        Path | None, typer.Option("--save", metavar="FILE.csv", help="file to write the demonstrations to")
    ] = None,
    marker: Marker = "",
    unit: Unit = "",
    up_axis: UpAxis = "",
    topic: Topic = "",
    plane: OnePlane = False,
    to_plate: ToPlate = False,
    server: Server = DEFAULT_SERVER,
    user: User = "",
    as_json: Json = False,
) -> None:
    """Record demonstrations on a workstation: from a tracker, or by replaying files.

    Each press of the push button is one demonstration. Ctrl-C ends a recording.
    """
    if (udp is not None) + bool(files) + bool(tracker) != 1:
        raise typer.BadParameter(
            "give one of --from FILE, --udp PORT and --tracker NAME", param_hint="--from / --udp / --tracker"
        )
    if on_interrupt not in ("ask", "finish", "discard"):
        raise typer.BadParameter(f"{on_interrupt!r} is not one of ask, finish, discard", param_hint="--on-interrupt")
    options = learning_options(option or [])
    shown: list[Demonstration] = []
    if files:
        choices = choices_of(marker, unit, up_axis, topic)
        shown = read_files(files, choices, Placing(plane=plane, fit_to_plate=to_plate))

    async def work(client: SkillClient) -> dict[str, Any]:
        recorder = client.workstation(on).recorder
        with stopping() as stop:
            source: Source
            if tracker:
                async with tracker_at(tracker) as source:
                    ended = await passed_on(recorder, source, operator, stop)
            elif udp is None:
                source = ReplaySource(shown, ", ".join(file.name for file in files or ())[:200], speed)
                ended = await passed_on(recorder, source, operator, stop)
            else:
                listening = UdpSource(silence=silence, wait=wait, only=sender)
                address, port = await listening.open(bind, udp)
                tell_address(address, port)
                try:
                    ended = await passed_on(recorder, listening, operator, stop)
                finally:
                    listening.close()
            told: dict[str, Any] = {
                "recording_id": ended.recording_id,
                "ended": ended.why,
                "samples": ended.samples,
                **ended.losses.as_dict(),
            }
            if ended.why == STOPPED and not await keep(on_interrupt, ended, stop):
                await recorder.discard(ended.recording_id)
                return {**told, "discarded": True, "demonstrations": []}
        found = await finished(recorder, ended)
        ignored = await recorder.state()
        told |= {"discarded": False, "ignored": ignored.ignored, "demonstrations": [described(one) for one in found]}
        if save is not None and found:
            from library.readers.plain_csv import write_all

            write_all(save, found)
            told["file"] = str(save)
        if learn:
            if len(found) < 2:
                raise Fault(
                    f"2 demonstrations are needed to learn {learn}, {len(found)} came: recording"
                    f" {ended.recording_id} ended, {ended.why}"
                )
            kind = semantic_type or await known_type(client, learn)
            learned = await recorder.learn(ended.recording_id, learn, kind, options)
            told["skill"] = await made_of_it(client, learn, learned)
        return told

    try:
        told = with_client(server, user, work)
    except SourceFault as fault:
        raise Fault(str(fault)) from fault
    if as_json:
        skill = told.pop("skill", None)
        print_json({**told, "skill": summary(skill) if skill else None})
        return
    tell(told, ignored=told.get("ignored", 0))


async def passed_on(recorder: Recorder, source: Source, operator: str, stop: asyncio.Event) -> Ended:
    """Record until the source ends or Ctrl-C, and show how it goes while a terminal is there to show it on."""
    with Live(Text(""), console=notes, auto_refresh=False, transient=True) as live:

        def progress(now: Progress) -> None:
            if notes.is_terminal:
                live.update(Text(line_of(now)), refresh=True)

        return await pass_on(
            recorder,
            source,
            operator=operator,
            stop=stop,
            on_start=lambda name: note(f"recording {name} on {recorder.path.split('/')[1]}: Ctrl-C ends it"),
            on_progress=progress,
        )


def line_of(now: Progress) -> str:
    """Return how a recording goes, on one line."""
    button = "● pressed" if now.trigger else "○ released"
    losses = now.losses.words()
    said = f"{counted(now.samples, 'sample')} · {counted(now.demonstrations, 'demonstration')} · button {button}"
    return f"{said} · not taken: {losses}" if losses else said


def tell_address(address: str, port: int) -> None:
    """Tell where the tracker has to send to, at once: whoever starts it waits for this line."""
    note(f"listening on {address}:{port}")
    if address not in (LOOPBACK, "::1"):
        note(f"anybody who reaches {address}:{port} can send samples: nothing protects UDP")


@contextlib.contextmanager
def stopping() -> Iterator[asyncio.Event]:
    """Yield an event that Ctrl-C and SIGTERM set while the block runs."""
    stop, loop = asyncio.Event(), asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    try:
        yield stop
    finally:
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.remove_signal_handler(number)


async def keep(on_interrupt: str, ended: Ended, stop: asyncio.Event) -> bool:
    """Return whether what was recorded is to be kept: nobody's work is lost by a key alone."""
    if on_interrupt != "ask" or not (sys.stdin.isatty() and sys.stderr.isatty()):
        return on_interrupt != "discard"
    stop.clear()
    kept = counted(ended.demonstrations, "demonstration")
    typer.echo(f"\nkeep the {kept} of this recording? [Y/n] ", err=True, nl=False)
    loop, line = asyncio.get_running_loop(), asyncio.get_running_loop().create_future()
    loop.add_reader(sys.stdin, lambda: line.done() or line.set_result(sys.stdin.readline()))
    again = asyncio.ensure_future(stop.wait())
    try:
        await asyncio.wait((line, again), return_when=asyncio.FIRST_COMPLETED)
    finally:
        loop.remove_reader(sys.stdin)
        again.cancel()
        await asyncio.gather(again, return_exceptions=True)
    return not (line.done() and line.result().strip().lower() in ("n", "no"))


async def finished(recorder: Recorder, ended: Ended) -> list[Demonstration]:
    """Finish the recording; a demonstration that the source itself broke off is discarded, and told.

    A tracker without a button is always on: there the one demonstration ends with the recording, and is kept.
    """
    found = await recorder.finish(ended.recording_id)
    if ended.pressed and found:
        last = found[-1].demonstration_id
        if ended.why == STOPPED or not ended.has_button:
            note(f"the button was still pressed at the end: {last} may be cut short")
        else:
            await recorder.discard(ended.recording_id, last)
            note(f"the button was still pressed at the end ({ended.why}): {last} is cut short, it is discarded")
            return found[:-1]
    return found


def described(one: Demonstration) -> dict[str, Any]:
    """Return a demonstration in numbers."""
    length = float(np.sqrt((np.diff(one.points, axis=0) ** 2).sum(axis=1)).sum())
    return {
        "demonstration_id": one.demonstration_id,
        "samples": len(one.times),
        "seconds": float(one.times[-1]),
        "length_m": length,
    }


def tell(told: dict[str, Any], *, ignored: int) -> None:
    """Tell a person what was recorded, what was not, and where it is now."""
    losses = Losses(**{name: told[name] for name in Losses().as_dict()})
    if words := losses.words():
        last = f" (the last: {losses.last_garbled})" if losses.last_garbled else ""
        note(f"not taken: {words}{last}")
    if told["discarded"]:
        say(f"recording {told['recording_id']} is discarded")
        return
    rows = [
        (one["demonstration_id"], one["samples"], f"{one['seconds']:.2f}", millimetres(one["length_m"], 1))
        for one in told["demonstrations"]
    ]
    show_table(table("recorded", ("demonstration", ">samples", ">s", ">mm"), rows))
    if ignored:
        note(f"{counted(ignored, 'press was', 'presses were')} too short to be a demonstration")
    ended = f"recording {told['recording_id']}: {counted(len(rows), 'demonstration')}; ended: {told['ended']}"
    say(f"{ended}; written to {told['file']}" if "file" in told else ended)
    skill: Skill | None = told.get("skill")
    if skill is not None:
        say_learned(skill)
    elif rows:
        note("it stays on the server for an hour: learn from it in the panel")
