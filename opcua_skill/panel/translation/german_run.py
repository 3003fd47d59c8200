"""German for what is said of running, replaying, approving and of a lost server."""

RUNNING: dict[str, str] = {
    # what to run
    "SIMULATION": "SIMULATION",
    "TEST (T1)": "TEST (T1)",
    "PRODUCTION (AUTO)": "PRODUKTION (AUTO)",
    "Test": "Testen",
    "nothing moves": "nichts bewegt sich",
    "the arm moves at reduced speed": "der Arm bewegt sich mit reduzierter Geschwindigkeit",
    "the arm moves at the speed of the recipe": "der Arm bewegt sich so schnell, wie das Rezept sagt",
    "needs the role operator": "nur mit der Rolle operator",
    "needs the role engineer": "nur mit der Rolle engineer",
    "Choose a skill to run.": "Fertigkeit wählen, die ausgeführt werden soll.",
    "Choose a recipe: how the skill is to be run.": "Rezept wählen: wie die Fertigkeit ausgeführt werden soll.",
    "choose skill and recipe first": "erst Fertigkeit und Rezept wählen",
    "asked for already": "schon angefordert",
    "not checked by the server yet": "vom Server noch nicht geprüft",
    "a simulation is under way": "eine Simulation läuft",
    "the arm waits for a reset": "der Arm wartet auf Quittierung",
    "something runs or waits here: see below": "hier läuft oder wartet etwas: siehe unten",
    "Queue another …": "Weiteren Lauf einreihen …",
    "Queue another run? It begins by itself when its turn comes.": (
        "Weiteren Lauf einreihen? Er beginnt von selbst, wenn er an der Reihe ist."
    ),
    "nothing runs": "nichts läuft",
    "Yes, queue": "Ja, einreihen",
    "No": "Nein",
    "how far the job is": "wie weit der Auftrag ist",
    "no connection, or the server does not answer": "keine Verbindung, oder der Server antwortet nicht",
    "Jobs here": "Aufträge hier",
    "Record": "Aufzeichnung",
    # the queue
    "QUEUE HELD": "WARTESCHLANGE ANGEHALTEN",
    "Release the queue": "Warteschlange freigeben",
    "Hold the queue": "Warteschlange anhalten",
    "since": "seit",
    "by": "durch",
    "arm": "Arm",
    "server": "Server",
    "a job was aborted": "ein Auftrag wurde abgebrochen",
    "motion was stopped": "die Bewegung wurde gestoppt",
    "a job failed": "ein Auftrag ist fehlgeschlagen",
    "contact with the arm was lost": "der Kontakt zum Arm ging verloren",
    "the arm stopped by itself, or stands where no job left it": (
        "der Arm hat von selbst angehalten oder steht, wo ihn kein Auftrag gelassen hat"
    ),
    "paused at the arm itself, not from here": "am Arm selbst angehalten, nicht von hier",
    "something was unfinished when the server ended": "etwas war unfertig, als der Server endete",
    "somebody asked for it": "jemand hat darum gebeten",
    "something moves, or is under way here": "hier bewegt sich etwas oder ist im Gange",
    "When the queue is released, this begins at once": "Sobald die Warteschlange frei ist, beginnt sofort",
    "Yes, release: it begins": "Ja, freigeben: es beginnt",
    "The queue is held: a run waits there until somebody releases it.": (
        "Die Warteschlange ist angehalten: ein Lauf wartet dort, bis jemand sie freigibt."
    ),
    "Nothing begins until somebody releases the queue. Before that: reset the arm if it waits for it, and send it to "
    "the start (below, at the arm).": (
        "Nichts beginnt, bis jemand die Warteschlange freigibt. Davor: den Arm quittieren, falls er darauf wartet, und "
        "zum Anfang schicken (unten, beim Arm)."
    ),
    # live and replay
    "LIVE": "LIVE",
    "nothing runs on the arm": "auf dem Arm läuft nichts",
    "nobody knows where the arm is": "niemand weiß, wo der Arm ist",
    "REPLAY": "WIEDERHOLUNG",
    "Replay": "Wiederholung",
    "▶ Play the replay": "▶ Wiederholung abspielen",
    "Hold the replay": "Wiederholung anhalten",
    "End the replay": "Wiederholung beenden",
    "measured on the arm": "am Arm gemessen",
    "simulated, nothing moved": "simuliert, nichts hat sich bewegt",
    "Path of the nozzle": "Bahn der Düse",
    "Grey dashes: planned · orange dots: the arm as it moves · in a replay blue: commanded, violet: measured or "
    "simulated": (
        "Grau gestrichelt: geplant · orange Punkte: der Arm, wie er sich bewegt · in einer Wiederholung blau: "
        "befohlen, violett: gemessen oder simuliert"
    ),
    # stop, home, loss
    "The arm stopped and waits. Look why, then reset: that moves nothing. After that, send it to the start: it never "
    "goes there by itself.": (
        "Der Arm hat angehalten und wartet. Ursache ansehen, dann quittieren: das bewegt nichts. Danach zum Anfang "
        "schicken: von selbst fährt er nie dorthin."
    ),
    "the arm moves slowly to where every run begins. See that its way is free.": (
        "der Arm fährt langsam dorthin, wo jeder Lauf beginnt. Darauf achten, dass der Weg frei ist."
    ),
    "the arm is not at rest": "der Arm ist nicht in Ruhe",
    "Stop motion is sent, no answer yet": "Stopp ist gesendet, noch keine Antwort",
    "NOT ANSWERING": "ANTWORTET NICHT",
    "The server does not answer. What you see here is old. Stop motion is still sent; until it is said to have "
    "arrived, use the emergency stop of the machine.": (
        "Der Server antwortet nicht. Die Anzeige ist veraltet. „Bewegung stoppen“ wird noch gesendet; bis "
        "gemeldet ist, dass es angekommen ist: Not-Halt der Maschine benutzen."
    ),
    "This page has lost the panel. What you see is old, and Stop motion does not arrive: use the emergency stop.": (
        "Diese Seite hat das Bedienpanel verloren. Die Anzeige ist veraltet, „Bewegung stoppen“ kommt nicht an: "
        "Not-Halt benutzen."
    ),
    "All of this page was read anew: it is true again.": "Diese Seite wurde ganz neu gelesen: sie stimmt wieder.",
    "Pages": "Seiten",
    # the card
    "What this run would do": "Was dieser Lauf tun würde",
    "What would run": "Was laufen würde",
    "The server checks this run …": "Der Server prüft diesen Lauf …",
    "The card of a run needs the role operator.": "Die Karte eines Laufs gibt es ab der Rolle operator.",
    "The run seen from above": "Der Lauf von oben",
    "The run seen from the side": "Der Lauf von der Seite",
    "Start": "Anfang",
    "End": "Ende",
    "part": "Teil",
    "plan": "Plan",
    "kept clear: the recipe does not say how large the part is": (
        "freigehalten: das Rezept nennt keine Größe des Teils"
    ),
    "time on the path, and with the ways there and back": "Zeit auf der Bahn, und mit Hin- und Rückweg",
    "nozzle speed": "Geschwindigkeit der Düse",
    "time steps": "Zeitschritte",
    "nozzle above the part": "Düse über dem Teil",
    "smallest distance to anything": "kleinster Abstand zu etwas",
    "valve opens": "Ventil öffnet",
    "valve closes": "Ventil schließt",
    "valve closed": "Ventil zu",
    "leaving the tube": "Verlassen des Schlauchs",
    "stops the run": "hält den Lauf an",
    "is told": "wird gemeldet",
    "It slows down nowhere.": "Er wird nirgends langsamer.",
    "cannot run": "kann nicht laufen",
    "and": "und",
    "more": "weitere",
    "out of reach": "außer Reichweite",
    "outside the workspace": "außerhalb des Arbeitsraums",
    "beyond the limit of a joint": "jenseits der Grenze eines Gelenks",
    "too fast for the arm": "zu schnell für den Arm",
    "too near to a pose in which the arm loses a direction": (
        "zu nah an einer Stellung, in der dem Arm eine Richtung fehlt"
    ),
    "too little room between arm and what surrounds it": "zu wenig Platz zwischen Arm und Umgebung",
    "a value that is not allowed": "ein unerlaubter Wert",
    "version approved last": "zuletzt freigegebene Version",
    "Since the version approved last": "Seit der zuletzt freigegebenen Version",
    "No version of this skill was approved before.": "Von dieser Fertigkeit war noch keine Version freigegeben.",
    "Decide": "Entscheiden",
    "Write a reason first: it is kept with the decision.": (
        "Erst eine Begründung schreiben: sie bleibt bei der Entscheidung."
    ),
    "who taught a version cannot approve it": "wer eine Version gezeigt hat, kann sie nicht freigeben",
    # recipes
    "Save and check": "Speichern und prüfen",
    "Saved. It can run on": "Gespeichert. Läuft auf",
    "Saved, but on": "Gespeichert, aber auf",
    "Saved, but it could not be checked": "Gespeichert, konnte aber nicht geprüft werden",
    "Delete …": "Löschen …",
    "Delete this recipe for good?": "Dieses Rezept endgültig löschen?",
    "Yes, delete": "Ja, löschen",
    "Part begins at x": "Teil beginnt bei x",
    "Part begins at y": "Teil beginnt bei y",
    "Part long along x": "Teil lang entlang x",
    "Part wide along y": "Teil breit entlang y",
    # teaching
    "Bring back": "Zurückholen",
    "Discard this recording for good? It cannot be brought back.": (
        "Diese Aufnahme endgültig verwerfen? Sie lässt sich nicht zurückholen."
    ),
    "Yes, discard": "Ja, verwerfen",
    "not taken": "nicht übernommen",
    "A file": "Eine Datei",
    "it is larger than 200 MB, or of no kind known": "sie ist größer als 200 MB oder von unbekannter Art",
}
