"""The languages that programs are written in: one file each, and one row here."""

from opcua_skill.programs import gcode, krl, ls, rapid, urscript
from opcua_skill.programs.values import Language

LANGUAGES: dict[str, Language] = {
    one.name: one for one in (urscript.LANGUAGE, krl.LANGUAGE, rapid.LANGUAGE, ls.LANGUAGE, gcode.LANGUAGE)
}
