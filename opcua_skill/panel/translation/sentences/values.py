"""What is said of a field of a skill, a recipe or a parameter that cannot be taken: ours, and pydantic's own words."""

VALUES = {
    "it lies in {n} to {n2} {unit}": "es liegt in {n} bis {n2} {unit}",
    # pydantic
    "field required": "das Feld fehlt",
    "extra inputs are not permitted": "ein Feld dieses Namens gibt es nicht",
    "input should be an object": "es muss ein Objekt mit benannten Feldern sein",
    "input should be a valid dictionary": "es muss ein Objekt mit benannten Feldern sein",
    "input should be a valid dictionary or instance of {name}": "es muss ein Objekt mit den Feldern von {name} sein",
    "input should be a valid tuple": "es muss eine Liste sein",
    "input should be a valid string": "es muss ein Text sein",
    "input should be a valid boolean": "es muss true oder false sein",
    "input should be a valid boolean, unable to interpret input": "es muss true oder false sein",
    "input should be a valid number": "es muss eine Zahl sein",
    "input should be a valid number, unable to parse string as a number": "es muss eine Zahl sein",
    "input should be a finite number": "es muss eine endliche Zahl sein",
    "input should be a valid integer": "es muss eine ganze Zahl sein",
    "input should be a valid integer, unable to parse string as an integer": "es muss eine ganze Zahl sein",
    "input should be a valid integer, got a number with a fractional part": "es muss eine ganze Zahl sein",
    "unable to parse input string as an integer, exceeded maximum size": "diese ganze Zahl ist zu groß",
    "input should be a valid datetime": "es muss ein Zeitpunkt sein",
    "input should be a valid datetime, dates before 0000 are not supported as unix timestamps": (
        "es muss ein Zeitpunkt sein, wie 2026-01-31T12:00:00Z"
    ),
    "input should be a valid datetime, {detail}": "es muss ein Zeitpunkt sein, wie 2026-01-31T12:00:00Z",
    "input should be a valid datetime or date, {detail}": "es muss ein Zeitpunkt sein, wie 2026-01-31T12:00:00Z",
    "input should be {n}": "erlaubt ist {n}",
    "input should be '{x}' or '{y}'": "erlaubt ist '{x}' oder '{y}'",
    "input should be greater than or equal to {n}": "es muss mindestens {n} sein",
    "input should be greater than {n}": "es muss über {n} liegen",
    "input should be less than or equal to {n}": "es darf höchstens {n} sein",
    "input should be less than {n}": "es muss unter {n} liegen",
    "string should have at least {n} character": "der Text braucht mindestens {n} Zeichen",
    "string should have at least {n} characters": "der Text braucht mindestens {n} Zeichen",
    "string should have at most {n} characters": "der Text darf höchstens {n} Zeichen haben",
    "string should match pattern '{x}'": "der Text muss dem Muster '{x}' folgen",
    "tuple should have at least {n} item after validation, not {n2}": "die Liste braucht mindestens {n} Eintrag",
    "tuple should have at least {n} items after validation, not {n2}": "die Liste braucht mindestens {n} Einträge",
    "tuple should have at most {n} items after validation, not {n2}": "die Liste darf höchstens {n} Einträge haben",
    "invalid JSON: EOF while parsing {what} at line {n} column {n2}": (
        "das ist kein gültiges JSON: es endet zu früh, in Zeile {n}, Spalte {n2}"
    ),
    "invalid JSON: key must be a string at line {n} column {n2}": (
        "das ist kein gültiges JSON: in Zeile {n}, Spalte {n2} fehlt ein Name in Anführungszeichen"
    ),
    "invalid JSON: {detail} at line {n} column {n2}": "das ist kein gültiges JSON: Zeile {n}, Spalte {n2}",
}
