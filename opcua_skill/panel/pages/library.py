"""The library: every skill, found by name, type or state."""

from urllib.parse import quote

from nicegui import ui
from nicegui.events import UploadEventArguments

from opcua_skill.client import ClientError, SkillSummary
from opcua_skill.panel.formatting import moment, state_tag
from opcua_skill.panel.layout import Frame, choose, title

STATES = ("Learned", "Approved", "Rejected", "Retired")
MOST = 200
LARGEST = 20_000_000


async def library_page(frame: Frame) -> None:
    """Show the skills; a change that anybody makes is shown at once."""
    words, session = frame.words, frame.session
    with ui.element("div").classes("sheet stack"):
        with ui.element("div").classes("line"):
            title(words("Skills"))
            name = (
                ui.input(placeholder=words("Name begins with …"))
                .props("dense outlined clearable")
                .props('data-mark="search"')
            )
            state = choose({"": words("every state"), **{one: words(one) for one in STATES}}, value="").style(
                "width:160px"
            )
            station = choose({"": words("every workstation"), **{one: one for one in session.stations}}, value="")
            station.style("width:192px")
            ui.space()
            count = ui.label().classes("soft")
            if session.may("import"):
                chosen = ui.upload(on_upload=lambda event: bring_in(event), auto_upload=True, max_file_size=LARGEST)
                chosen.props('accept=".json" data-mark="import"').classes("unseen")
                # in the browser: a file list opens only where a person has just pressed something
                pick = f"() => document.querySelector('#c{chosen.id} input[type=file]').click()"
                ui.button(words("Import a skill"), icon="upload_file").on("click", js_handler=pick).props(
                    "no-caps outline dense"
                )
        refused = ui.label().classes("check-bad").props('data-mark="import-refusal"')
        with (
            ui.element("div").classes("scrolls").props("tabindex=0"),
            ui.element("table").classes("panel-table").props('data-mark="skills"') as table,
        ):
            pass
        nothing = ui.label().classes("soft")

    found: list[SkillSummary] = []
    runs_on: dict[str, list[str]] = {}
    shown: dict[str, object] = {"found": None, "runs_on": None}

    async def find() -> None:
        async def ask() -> None:
            found[:] = await session.client.find_skills(
                name_prefix=name.value or "", state=state.value, workstation=station.value, limit=MOST
            )
            runs_on.clear()
            for one in session.stations:  # the version that is deployed is often not the newest one
                for skill in await session.client.find_skills(
                    name_prefix=name.value or "", workstation=one, limit=MOST
                ):
                    runs_on.setdefault(skill.name, []).append(f"{one}: {words('version')} {skill.version}")

        if await frame.asked(words("Search"), ask) and (found, runs_on) != (shown["found"], shown["runs_on"]):
            shown.update(found=list(found), runs_on=dict(runs_on))
            show()

    async def bring_in(event: UploadEventArguments) -> None:
        """Store a skill that was exported elsewhere, in state Learned: here it has to be approved again."""
        refused.text = ""
        try:
            text = (await event.file.read()).decode("utf-8")
            name, version = await session.client.import_skill(text)
        except UnicodeDecodeError:
            refused.text = f"✕ {event.file.name}: {words('this is no exported skill, which is a JSON file')}"
            return
        except ClientError as error:
            refused.text = f"✕ {event.file.name}: {words.said(error)}"
            return
        frame.tell(f"{words('Imported')}: {name} {words('version')} {version}")
        await find()

    def show() -> None:
        count.text = words.count(len(found), "skill", "skills") + (
            f" ({words('the first ones')})" if len(found) >= MOST else ""
        )
        nothing.text = (
            "" if found else words("No skill matches. Teach one: draw it, upload recordings, or use a tracker.")
        )
        table.clear()
        with table:
            with ui.element("tr"):
                for head in ("Skill", "Type", "Version", "State", "Taught by", "When", "Runs on"):
                    with ui.element("th").props("scope=col"):
                        ui.label(words(head))
            for one in found:
                row(one)

    def row(one: SkillSummary) -> None:
        target = f"/skill/{quote(one.name, safe='')}"
        with ui.element("tr").classes("clickable").on("click", lambda: ui.navigate.to(target)):
            with ui.element("td"):
                ui.link(one.name, target)
            for cell in (one.semantic_type, str(one.version)):
                with ui.element("td"):
                    ui.label(cell)
            with ui.element("td"):
                ui.html(state_tag(words, one.state), sanitize=False)
            for cell in (one.created_by, moment(one.created_at), ", ".join(runs_on.get(one.name, [])) or "–"):
                with ui.element("td"):
                    ui.label(cell)

    for field in (name, state, station):
        field.on_value_change(find)
    await find()
    seen = {"last": session.happenings[0].number if session.happenings else 0}

    async def look() -> None:
        """Search again when the library has changed: whoever changed it, here or elsewhere."""
        newest = session.happenings[0].number if session.happenings else 0
        if newest != seen["last"]:
            fresh = [one.event for one in session.happenings if one.number > seen["last"]]
            seen["last"] = newest
            if any(event.skill_name and not event.job_id for event in fresh):
                await find()

    ui.timer(0.5, look)
