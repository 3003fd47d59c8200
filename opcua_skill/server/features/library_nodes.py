"""The face of the skill library: `SkillLibrary`, its methods and its limits."""

from collections.abc import Awaitable, Callable, Sequence
from typing import Any

from asyncua import ua
from asyncua.ua.object_ids import ObjectIds

from models.options import preset_names
from opcua_skill.configuration.settings import Limits
from opcua_skill.security.access import Role
from opcua_skill.server.address_space import Tree, count, number, standard, texts
from opcua_skill.server.features.library import LibraryMethods
from opcua_skill.server.types import BOOLEAN, BYTE, BYTE_STRING, DOUBLE, STATUS_CODE, STRING, UINT32
from opcua_skill.server.units import BYTE as BYTES
from opcua_skill.server.units import SECOND, measured
from opcua_skill.stack.address_space.events import make_notifier
from opcua_skill.stack.services.calls import Argument, MethodSpec, add_method

PATH = "SkillLibrary"
LONGEST_HOLD = 3600.0  # s, the upper end of the range that is told
READERS = Role.OBSERVER.and_above
OPERATORS = Role.OPERATOR.and_above
TEACHERS = Role.TEACHER.and_above
ENGINEERS = Role.ENGINEER.and_above

SKILL = Argument("SkillName", STRING, description="name of the skill")
VERSION = Argument("Version", UINT32, description="0: the newest")
COMMENT = Argument("Comment", STRING, description="why, for the record")
DIGEST = Argument("ModelDigest", BYTE_STRING, description="SHA-256 of the model that was looked at")
WORKSTATION = Argument("Workstation", STRING)
STATE = Argument("State", STRING)
RECIPE_ID = Argument("RecipeId", STRING)
FORMAT = Argument("Format", STRING, description="json")
JOB_ID = Argument("JobId", STRING)


def method(
    name: str,
    handler: Callable[..., Awaitable[tuple[Any, ...]]],
    roles: frozenset[Role],
    inputs: tuple[Argument, ...],
    outputs: tuple[Argument, ...],
    *,
    changes: bool = True,
    seconds: float = 30.0,
    urgent: bool = False,
) -> MethodSpec:
    """Return the specification of a method, described by its handler's first line."""
    description = (handler.__doc__ or "").strip().split("\n")[0]
    return MethodSpec(name, inputs, outputs, handler, roles, changes, description, seconds, urgent)


def specs(tree: Tree, methods: LibraryMethods) -> tuple[MethodSpec, ...]:
    """Return the methods of SkillLibrary: arguments as in docs/interface.md, rights as in its section on roles."""
    demonstrations = tree.type_id("DemonstrationDataType")
    options = tree.type_id("LearningOptionsDataType")
    summary = tree.type_id("SkillSummaryDataType")
    recipe = tree.type_id("RecipeDataType")
    report = tree.type_id("JobReportDataType")
    return (
        method(
            "LearnFromDemonstration",
            methods.learn_from_demonstration,
            TEACHERS,
            (
                SKILL,
                Argument("SemanticType", STRING, description="what kind of skill, such as Gluing or an IRI"),
                Argument("Demonstrations", demonstrations, 1),
                Argument("Options", options),
            ),
            (
                JOB_ID,
                STATE,
                Argument("SkillVersion", UINT32, description="0 while the job goes on"),
                Argument("DemonstrationResults", STATUS_CODE, 1),
                Argument("Report", STRING, description="JSON: verdicts and quality"),
            ),
        ),
        method(
            "FindSkills",
            methods.find_skills,
            READERS,
            (
                Argument("SemanticType", STRING, description="empty: any"),
                Argument("State", STRING, description="empty: any"),
                Argument("Workstation", STRING, description="empty: any"),
                Argument("NamePrefix", STRING, description="empty: any"),
                Argument("After", STRING, description="Next of the page before; empty: the first page"),
                Argument("Limit", UINT32, description="0: the server's limit"),
            ),
            (Argument("Skills", summary, 1), Argument("Next", STRING, description="empty: no more")),
            changes=False,
        ),
        method(
            "GetSkill",
            methods.get_skill,
            READERS,
            (SKILL, VERSION),
            (Argument("Description", STRING, description="JSON"),),
            changes=False,
        ),
        method(
            "GetDemonstrations",
            methods.get_demonstrations,
            READERS,
            (SKILL, VERSION),
            (Argument("Raw", demonstrations, 1), Argument("Aligned", demonstrations, 1)),
            changes=False,
        ),
        method(
            "GetTrajectory",
            methods.get_trajectory,
            READERS,
            (
                SKILL,
                VERSION,
                Argument("RecipeId", STRING, description="empty: as learned"),
                Argument("TimeStep", DOUBLE, description="s; 0: the recipe's"),
            ),
            (
                Argument("Dimension", BYTE),
                Argument("Times", DOUBLE, 1, "s"),
                Argument("Positions", DOUBLE, 1, "m, row-major, Dimension values a sample"),
                Argument("Covariances", DOUBLE, 1, "m², row-major, Dimension² values a sample"),
                Argument("Dispense", BOOLEAN, 1),
            ),
            changes=False,
        ),
        method(
            "RemovePoints",
            methods.remove_points,
            TEACHERS,
            (
                SKILL,
                VERSION,
                Argument("DemonstrationId", STRING, description="empty: samples of the learned path"),
                Argument("Indices", UINT32, 1),
                COMMENT,
            ),
            (Argument("SkillVersion", UINT32),),
            seconds=90.0,
        ),
        method("Approve", methods.approve, ENGINEERS, (SKILL, VERSION, DIGEST, COMMENT), (STATE,)),
        method("Reject", methods.reject, ENGINEERS, (SKILL, VERSION, DIGEST, COMMENT), (STATE,)),
        method("Deploy", methods.deploy, ENGINEERS, (SKILL, VERSION, WORKSTATION), (STATE,)),
        method("Withdraw", methods.withdraw, ENGINEERS, (SKILL, VERSION, WORKSTATION), (STATE,)),
        method("Retire", methods.retire, ENGINEERS, (SKILL, VERSION, COMMENT), (STATE,)),
        method(
            "ExportSkill",
            methods.export_skill,
            READERS,
            (SKILL, VERSION, FORMAT),
            (Argument("Content", STRING),),
            changes=False,
        ),
        method(
            "ImportSkill",
            methods.import_skill,
            TEACHERS,
            (Argument("Content", STRING), FORMAT),
            (SKILL, Argument("SkillVersion", UINT32)),
        ),
        method("PutRecipe", methods.put_recipe, ENGINEERS, (Argument("Recipe", recipe),), ()),
        method("GetRecipe", methods.get_recipe, OPERATORS, (RECIPE_ID,), (Argument("Recipe", recipe),), changes=False),
        method(
            "ListRecipes", methods.list_recipes, OPERATORS, (SKILL,), (Argument("Recipes", recipe, 1),), changes=False
        ),
        method("DeleteRecipe", methods.delete_recipe, ENGINEERS, (RECIPE_ID,), ()),
        method("GetJob", methods.get_job, READERS, (JOB_ID,), (Argument("Report", report),), changes=False),
    )


async def add_library(
    tree: Tree, methods: LibraryMethods, limits: Limits, largest_message: int, insecure: Sequence[str], four_eyes: bool
) -> None:
    """Add the library to the Objects folder.

    ``largest_message`` is what the server takes in one call, in bytes; ``insecure`` what its configuration weakens,
    ``four_eyes`` whether who taught a version cannot approve it.
    """
    library = tree.object(
        PATH,
        standard(ObjectIds.ObjectsFolder),
        type_definition=tree.type_id("SkillLibraryType"),
        reference=ObjectIds.Organizes,
        description="learned skills: versions, approvals, recipes",
    )
    await make_notifier(tree.server.get_node(library))
    for spec in specs(tree, methods):
        tree.declare_method("SkillLibraryType", spec)
        await add_method(tree.server, library, spec, tree.id(f"{PATH}/{spec.name}"), tree.name(spec.name))
    bounds = tree.object(f"{PATH}/Limits", library, type_definition=tree.type_id("LibraryLimitsType"))
    for name, value in (
        ("MaxDemonstrations", limits.max_demonstrations),
        ("MaxPointsPerDemonstration", limits.max_points_per_demonstration),
        ("MaxQueuedJobs", limits.max_queued_jobs),
        ("MaxTrajectorySamples", limits.max_trajectory_samples),
        ("MaxContentLength", limits.max_content),
        ("MaxPage", limits.max_page),
    ):
        tree.property(f"{PATH}/Limits/{name}", bounds, count(value))
    for name, value in (
        ("MaxMessageSize", largest_message),
        ("MaxAnswerSize", tree.server.stack_limits.largest_answer),  # type: ignore[attr-defined]
    ):
        measured(tree, f"{PATH}/Limits/{name}", bounds, count(value), BYTES, (0, value))
    presets = texts(preset_names())
    tree.property(f"{PATH}/Presets", library, presets, description="ways to learn, for LearningOptions.Preset")
    tree.property(f"{PATH}/Faults", library, texts(()), description="what ServiceLevel is lowered for, in words")
    meaning = "how long the event loop was held longest"
    measured(tree, f"{PATH}/LongestHold", library, number(0.0), SECOND, (0.0, LONGEST_HOLD), description=meaning)
    tree.property(f"{PATH}/Holds", library, count(0), description="how often it was held for more than 20 ms")
    tree.property(f"{PATH}/FaultKinds", library, texts(()), description="the same, in one word each")
    leased = "workstations of all servers that share the library; empty: it is not shared"
    tree.property(f"{PATH}/LeasedWorkstations", library, texts(()), description=leased)
    tree.property(f"{PATH}/LeasedBy", library, texts(()), description="the address of the server that has each")
    asked = ua.Variant(four_eyes, ua.VariantType.Boolean)
    tree.property(f"{PATH}/FourEyes", library, asked, description="who taught a version cannot approve it")
    tree.property(f"{PATH}/Insecure", library, texts(insecure), description="what the configuration weakens, in words")
