"""`Machines/<Workstation>/Recorder`: the door for trackers, and what a live view watches."""

from asyncua import ua

from opcua_skill.server.address_space import Tree, count, text
from opcua_skill.server.features.library_nodes import JOB_ID, READERS, SKILL, STATE, TEACHERS, method
from opcua_skill.server.features.recorder import LARGEST_ANSWER, RecorderMethods
from opcua_skill.server.recording import ALL_SAMPLES, ONE_ANSWER, ONE_APPEND
from opcua_skill.server.types import BOOLEAN, BYTE, DOUBLE, STATUS_CODE, STRING, UINT32
from opcua_skill.stack.services.calls import Argument, MethodSpec, add_method

RECORDING = Argument("RecordingId", STRING)
NEWEST = Argument("RecordingId", STRING, description="empty: the open one or, if none is, the newest")
DEMONSTRATION = Argument("DemonstrationId", STRING)
DIMENSION = Argument("Dimension", BYTE, description="2 or 3")
OPERATOR = Argument("Operator", STRING, description="who demonstrates; empty: the caller")
SOURCE = Argument("Source", STRING, description="tracker or file, in words")
TIMES = Argument("Times", DOUBLE, 1, "s, strictly increasing, also from append to append")
POSITIONS = Argument("Positions", DOUBLE, 1, "m, row-major, Dimension values a sample")
TRIGGERS = Argument("Triggers", BOOLEAN, 1, "push button; empty: as the variable Trigger was written, or on")
ORIENTATIONS = Argument("Orientations", DOUBLE, 1, "unit quaternions x y z w, four values a sample; empty: none")


def specs(tree: Tree, methods: RecorderMethods) -> tuple[MethodSpec, ...]:
    """Return the methods of a recorder. An append is not recorded in the audit trail: there are ten a second."""
    demonstration = tree.type_id("DemonstrationDataType")
    return (
        method("StartRecording", methods.start_recording, TEACHERS, (DIMENSION, OPERATOR, SOURCE), (RECORDING,)),
        method(
            "AppendSamples",
            methods.append_samples,
            TEACHERS,
            (RECORDING, TIMES, POSITIONS, TRIGGERS, ORIENTATIONS),
            (
                Argument("Samples", UINT32, description="samples of the recording so far"),
                Argument("Demonstrations", UINT32, description="presses of the button so far, this one included"),
            ),
            changes=False,
        ),
        method(
            "FinishRecording",
            methods.finish_recording,
            TEACHERS,
            (RECORDING,),
            (Argument("Demonstrations", demonstration, 1),),
        ),
        method(
            "GetRecording",
            methods.get_recording,
            READERS,
            (NEWEST, Argument("After", UINT32, description="how many samples are known already")),
            (
                RECORDING,
                DIMENSION,
                Argument("Operator", STRING),
                SOURCE,
                Argument("Recording", BOOLEAN, description="whether it is open"),
                Argument("Samples", UINT32, description="how many samples there are"),
                Argument("Times", DOUBLE, 1, "s, from the first sample of the recording"),
                POSITIONS,
                Argument("Triggers", BOOLEAN, 1, "push button"),
                ORIENTATIONS,
            ),
            changes=False,
        ),
        method(
            "ListDemonstrations",
            methods.list_demonstrations,
            READERS,
            (NEWEST,),
            (
                Argument("DemonstrationIds", STRING, 1),
                Argument("First", UINT32, 1, "sample each begins with"),
                Argument("Last", UINT32, 1, "sample each ends with"),
                Argument("Pressed", BOOLEAN, description="whether the last one is being shown now"),
            ),
            changes=False,
        ),
        method(
            "GetDemonstration",
            methods.get_demonstration,
            READERS,
            (RECORDING, DEMONSTRATION),
            (Argument("Demonstration", demonstration),),
            changes=False,
        ),
        method(
            "DiscardRecording",
            methods.discard_recording,
            TEACHERS,
            (RECORDING, Argument("DemonstrationId", STRING, description="empty: the whole recording")),
            (Argument("Demonstrations", UINT32, description="how many are left"),),
        ),
        method(
            "LearnFromRecording",
            methods.learn_from_recording,
            TEACHERS,
            (
                RECORDING,
                SKILL,
                Argument("SemanticType", STRING, description="what kind of skill, such as Gluing or an IRI"),
                Argument("Options", tree.type_id("LearningOptionsDataType")),
            ),
            (
                JOB_ID,
                STATE,
                Argument("SkillVersion", UINT32, description="0 while the job goes on"),
                Argument("DemonstrationResults", STATUS_CODE, 1),
                Argument("Report", STRING, description="JSON: verdicts and quality"),
            ),
        ),
    )


class RecorderNodes:
    """The variables of one recorder; `show` writes those that changed."""

    def __init__(self, tree: Tree, methods: RecorderMethods) -> None:
        self.methods = methods
        self._tree = tree
        self._path = f"Machines/{methods.workstation}/Recorder"
        self._shown: dict[str, ua.Variant] = {}

    def values(self) -> dict[str, ua.Variant]:
        """Return what is to be shown now."""
        recording = self.methods.newest
        boolean = ua.VariantType.Boolean
        return {
            "Recording": ua.Variant(recording is not None and recording.is_open, boolean),
            "Trigger": ua.Variant(self.methods.trigger, boolean),
            "RecordingId": text(recording.recording_id if recording else ""),
            "Samples": count(recording.samples if recording else 0),
            "DemonstrationCount": count(len(recording.all_presses) if recording else 0),
            "Ignored": count(recording.button.ignored if recording else 0),
            "LastIgnored": text(recording.button.last_ignored if recording else ""),
        }

    async def show(self) -> None:
        """Bring the variables up to date, and forget what was kept long enough."""
        self.methods.forget_old()
        for name, value in self.values().items():
            if self._shown.get(name) != value:
                await self._tree.write(f"{self._path}/{name}", value)
                self._shown[name] = value


DESCRIPTIONS = {
    "Recording": "whether a recording is open",
    "Trigger": "push button; writable, for trackers that send none with their samples",
    "RecordingId": "the open recording or, if none is, the newest",
    "Samples": "samples of that recording",
    "DemonstrationCount": "presses of the button that are demonstrations, the one being shown included",
    "Ignored": "presses of that recording that were too short to be a demonstration",
    "LastIgnored": "the last of them, in words",
}


async def add_recorder(tree: Tree, methods: RecorderMethods) -> RecorderNodes:
    """Add the recorder to its workstation."""
    path = f"Machines/{methods.workstation}/Recorder"
    root = tree.object(
        path,
        tree.id(f"Machines/{methods.workstation}"),
        type_definition=tree.type_id("RecorderType"),
        description="demonstrations from a tracker",
    )
    nodes = RecorderNodes(tree, methods)
    for name, value in nodes.values().items():
        tree.variable(f"{path}/{name}", root, value, description=DESCRIPTIONS[name], writable=name == "Trigger")
    trigger = tree.id(f"{path}/Trigger")
    tree.server.restrict_writes(trigger, TEACHERS)  # type: ignore[attr-defined]
    tree.server.obey_writes(trigger, methods.press)  # type: ignore[attr-defined]
    for name, most, meaning in (
        ("MaxSamplesPerAppend", ONE_APPEND, "samples in one AppendSamples"),
        ("MaxSamplesPerAnswer", ONE_ANSWER, "samples in one answer of GetRecording"),
        ("MaxSamplesPerFinish", LARGEST_ANSWER, "samples up to which FinishRecording sends all demonstrations"),
        ("MaxSamples", ALL_SAMPLES, "samples of all recordings that are kept"),
    ):
        tree.property(f"{path}/{name}", root, count(most), description=meaning)
    for spec in specs(tree, methods):
        tree.declare_method("RecorderType", spec)
        await add_method(tree.server, root, spec, tree.id(f"{path}/{spec.name}"), tree.name(spec.name))
    return nodes
