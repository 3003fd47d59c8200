"""`SkillLibrary/LearnAgain`: a version learned again with what an operator left out, struck, or included again."""

from dataclasses import dataclass
from typing import Any

from library.errors import NotFound
from library.store import SkillLibrary
from library.values import check_text
from models.demonstration import Edits
from opcua_skill.configuration.settings import Settings
from opcua_skill.jobs import JobEngine, LearningRequest
from opcua_skill.security.access import caller
from opcua_skill.server.address_space import Tree
from opcua_skill.server.features.library_nodes import COMMENT, JOB_ID, PATH, SKILL, STATE, TEACHERS, VERSION, method
from opcua_skill.server.types import UINT32
from opcua_skill.stack.services.calls import Argument, add_method
from opcua_skill.wire.refusals import out_of_range, refusing


@dataclass(frozen=True)
class EditMethods:
    """The handler of LearnAgain."""

    library: SkillLibrary
    jobs: JobEngine
    settings: Settings

    @refusing(blame="Edits", fields={"comment": "Comment"})
    async def learn_again(self, skill_name: str, version: int, given: list[Any], comment: str) -> tuple[Any, ...]:
        """Learn a new version from a version's recordings with exactly these edits, one entry a recording at most."""
        check_text(comment, "comment", 2000)
        description = await self.library.description(skill_name, version)
        recordings = await self.library.recordings(skill_name, description.version)
        lengths = {one.demonstration_id: len(one.times) for one in recordings}
        excluded: set[str] = set()
        struck: dict[str, frozenset[int]] = {}
        for edit in given:
            name = edit.DemonstrationId
            if name not in lengths:
                raise NotFound("demonstration", name)
            if name in struck:
                raise out_of_range("Edits", f"there are two entries for demonstration {name}")
            if len(edit.Struck or ()) > lengths[name]:
                raise out_of_range("Edits", f"{name} has {lengths[name]} samples, {len(edit.Struck)} were named")
            struck[name] = frozenset(edit.Struck or ())
            if struck[name] and max(struck[name]) >= lengths[name]:
                last = lengths[name] - 1
                raise out_of_range("Edits", f"{name} has samples 0 to {last}, {max(struck[name])} was named")
            if edit.Excluded:
                excluded.add(name)
        outcome = await self.jobs.learn(
            LearningRequest(
                skill_name=skill_name,
                semantic_type=description.semantic_type,
                required_atomic_skills=description.required_atomic_skills,
                recordings=recordings,
                edits=Edits(frozenset(excluded), {name: samples for name, samples in struck.items() if samples}),
                options=await self.library.options(skill_name, description.version),
                actor=caller().name,
                comment=comment,
                based_on=description.version,
            ),
            answer_within=self.settings.learning.answer_within,
        )
        return (outcome.report.job_id, outcome.report.state.value, outcome.report.skill_version)


async def add_edits(tree: Tree, methods: EditMethods) -> None:
    """Add the method to the library."""
    edits = Argument("Edits", tree.type_id("DemonstrationEditsDataType"), 1, "recordings without an entry are whole")
    version = Argument("SkillVersion", UINT32, description="0 while the job goes on")
    spec = method(
        "LearnAgain",
        methods.learn_again,
        TEACHERS,
        (SKILL, VERSION, edits, COMMENT),
        (JOB_ID, STATE, version),
    )
    tree.declare_method("SkillLibraryType", spec)
    await add_method(tree.server, tree.id(PATH), spec, tree.id(f"{PATH}/{spec.name}"), tree.name(spec.name))
