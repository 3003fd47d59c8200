"""What is said of motions: findings of the checks, what the arm refuses, and how a run ended."""

MOTION = {
    "on the way to or from the path": "auf dem Weg zur Bahn oder von ihr",
    "at home": "in der Grundstellung",
    "at {n} s, {n2} % of the path": "bei {n} s, {n2} % der Bahn",
    "{t} (and {n} more)": "{t} (und {n} weitere)",
    "plan {x}": "Plan {x}",
    # checks
    "of {x} nobody has confirmed {y}: look at each in its limits file and take its name out of to_confirm": (
        "von {x} hat niemand {y} bestätigt: jedes in der Grenzwertdatei ansehen und seinen Namen aus to_confirm nehmen"
    ),
    "{t} is {x}: it has to be {t2}": "{t} ist {x}: erlaubt ist {t2}",
    "{t} is {n} s: it has to be {t2}": "{t} ist {n} s: erlaubt ist {t2}",
    "{t} is {n}: it has to be {t2}": "{t} ist {n}: erlaubt ist {t2}",
    "time step": "Zeitschritt",
    "time steps": "Zeitschritte",
    "timing": "Zeitverhalten",
    "duration": "Dauer",
    "speed": "Geschwindigkeit",
    "speed override": "Geschwindigkeitsanteil",
    "speed fraction": "Geschwindigkeitsfaktor",
    "standoff": "Abstand der Düse",
    "approach height": "Anfahrhöhe",
    "retract height": "Abhebehöhe",
    "dispense lead": "Vorlauf des Ventils",
    "largest deviation": "größte Abweichung",
    "chord tolerance": "Sehnenabweichung",
    "blend radius": "Eckenradius",
    "tube": "Schlauch",
    "nozzle turn": "Drehung der Düse",
    "frame": "Lage des Teils",
    "frame's quaternion": "Quaternion der Lage",
    "path": "Bahn",
    "joints": "Gelenke",
    "from {n} s to {n2} s": "{n} s bis {n2} s",
    "from {n} s (as learned) to {n2} s": "{n} s (wie gelernt) bis {n2} s",
    "from {n} to {n2} m/s": "{n} bis {n2} m/s",
    "from {n} m to {n2} m": "{n} m bis {n2} m",
    "from {n} (not watched) to {n2} m": "{n} (nicht überwacht) bis {n2} m",
    "from {n} (not watched) to {n2} standard deviations": "{n} (nicht überwacht) bis {n2} Standardabweichungen",
    "from 0 (not known) to {n} m": "0 (nicht bekannt) bis {n} m",
    "part's x": "x des Teils",
    "part's y": "y des Teils",
    "part's length": "Länge des Teils",
    "part's width": "Breite des Teils",
    "from {n} mm to {n2} m": "{n} mm bis {n2} m",
    "more than 0 m/s for a constant speed": "mehr als 0 m/s für konstante Geschwindigkeit",
    "more than 0 and at most 1": "mehr als 0 und höchstens 1",
    "one of {x}": "eines von {x}",
    "{n} m/s": "{n} m/s",
    "of length {n}": "Länge {n}",
    "seven finite numbers: x y z in m, then a quaternion x y z w": "sieben endliche Zahlen: x y z in m, dann x y z w",
    "longer than 0.01 mm": "länger als 0,01 mm",
    "{n} finite numbers": "{n} endliche Zahlen",
    "the nozzle leaves the workspace of {arm} {t}, at x {n} y {n2} z {n3} mm, by up to {n4} mm: move the "
    "part's frame": (
        "die Düse verlässt den Arbeitsraum von {arm} {t}, an x {n} y {n2} z {n3} mm, um bis zu {n4} mm: Teil "
        "verschieben"
    ),
    "the nozzle leaves the workspace of {arm} on the way to or from the path by {n} mm": (
        "die Düse verlässt auf dem Weg zur Bahn oder von ihr den Arbeitsraum von {arm} um {n} mm"
    ),
    "{arm} cannot reach {n} of {n2} points of the path, the first {t} (point {n3}), and misses by up to {n4} mm and "
    "{n5} degrees: move the part's frame nearer": (
        "{arm} erreicht {n} von {n2} Punkten der Bahn nicht, den ersten {t} (Punkt {n3}), und verfehlt sie um bis zu "
        "{n4} mm und {n5} Grad: Teil näher rücken"
    ),
    "{arm} reaches the path with the nozzle upright, but not tilted by {n} degrees as it was shown {t}: move or turn "
    "the part's frame, let the nozzle turn freely about its axis, or teach with less tilt": (
        "{arm} erreicht die Bahn mit aufrechter Düse, aber nicht um {n} Grad geneigt, wie gezeigt {t}: Teil "
        "verschieben "
        "oder drehen, Düse frei um ihre Achse drehen lassen oder mit weniger Neigung zeigen"
    ),
    "{arm} would have to change its posture {t}, where joint {n} jumps by {n2} degrees: move or turn the part's frame, "
    "or tilt the nozzle less": (
        "{arm} müsste {t} seine Haltung wechseln, Gelenk {n} spränge um {n2} Grad: Teil verschieben oder "
        "drehen oder die "
        "Düse weniger neigen"
    ),
    "joint {n} of {arm} leaves its range {t} by up to {n2} {t2}: move or turn the part's frame": (
        "Gelenk {n} von {arm} verlässt seinen Bereich {t} um bis zu {n2} {t2}: Teil verschieben oder drehen"
    ),
    "degrees": "Grad",
    "mm": "mm",
    "{arm} is stretched out or folded {t}: its smallest singular value is {n}, at least {n2} is needed: "
    "move the part's "
    "frame": (
        "{arm} ist {t} gestreckt oder gefaltet: kleinster Singulärwert {n}, mindestens {n2} ist nötig: Teil verschieben"
    ),
    "joint {n} of {arm} would need {n2} times its {t} limit {t2}: go slower, or give the corners a blend radius": (
        "Gelenk {n} von {arm} bräuchte {t2} das {n2}-fache seiner Grenze der {t}: langsamer fahren oder Ecken runden"
    ),
    "velocity": "Geschwindigkeit",
    "acceleration": "Beschleunigung",
    "jerk": "Ruck",
    "{t} would be {n} mm apart {t2}, {t3}": "{t} wären {t2} {n} mm auseinander, {t3}",
    "{t} would be {n} mm inside each other {t2}, {t3}": "{t} wären {t2} {n} mm ineinander, {t3}",
    "{t} would be {n} mm apart at {n2} s, {n3} % of the path, {t3}": (
        "{t} wären bei {n2} s, {n3} % der Bahn {n} mm auseinander, {t3}"
    ),
    "{t} would be {n} mm inside each other at {n2} s, {n3} % of the path, {t3}": (
        "{t} wären bei {n2} s, {n3} % der Bahn {n} mm ineinander, {t3}"
    ),
    "{n} mm are needed: move the part or clear the way": "{n} mm sind nötig: Teil verschieben oder Weg freiräumen",
    "the path would take {n} time steps: it has to be at most {n2}, go faster or use longer steps": (
        "die Bahn bräuchte {n} Zeitschritte: höchstens {n2} sind erlaubt, schneller fahren oder längere Schritte wählen"
    ),
    "{n} mm long": "{n} mm lang",
    "{a} and {b} of {arm}": "{a} und {b} von {arm}",
    "{a} of {arm} and the {t}": "{a} von {arm} und {t}",
    "{a} of {arm} and the {name}": "{a} von {arm} und {name}",
    "table": "Tisch",
    "part": "Teil",
    "time step is {n} ms: straight lines between the samples cut the path by {n2} mm where {n3} mm are "
    "allowed: at most "
    "{n4} ms, or go slower": (
        "der Zeitschritt ist {n} ms: Geraden zwischen den Punkten schneiden die Bahn um {n2} mm ab, {n3} mm "
        "sind erlaubt: "
        "höchstens {n4} ms, oder langsamer fahren"
    ),
    "the path cannot be run in {n} s: {arm} needs at least {n2} s": (
        "die Bahn ist nicht in {n} s zu fahren: {arm} braucht mindestens {n2} s"
    ),
    "slowed to {n} mm/s at {n2} % of the path, where the people's pace is {n3} mm/s: {arm} cannot turn faster there": (
        "verlangsamt auf {n} mm/s bei {n2} % der Bahn, wo die Menschen {n3} mm/s fuhren: schneller wendet "
        "{arm} dort nicht"
    ),
    "speed is {n} mm/s: the nozzle of {arm} may go {n2} mm/s at most": (
        "die Geschwindigkeit ist {n} mm/s: die Düse von {arm} darf höchstens {n2} mm/s"
    ),
    "{t}, a corner allows {n} mm/s": "{t} erlaubt eine Ecke {n} mm/s",
    "{t}, the way into the path and out of it allows {n} mm/s": (
        "{t} erlaubt der Weg in die Bahn und aus ihr {n} mm/s"
    ),
    "{t}, a time step of {n} ms allows {n2} mm/s": "{t} erlaubt ein Zeitschritt von {n} ms {n2} mm/s",
    "slowed from {n} to {n2} mm/s in corners: {t}": "in Ecken von {n} auf {n2} mm/s verlangsamt: {t}",
    "the whole path is run {n} times slower than its timing: {arm} needs that between two samples": (
        "die ganze Bahn wird {n}-mal langsamer gefahren als ihr Zeitplan: {arm} braucht das zwischen zwei Punkten"
    ),
    "{arm} has {n} axes: its nozzle leans by up to {n2} degrees from how it should be held {t}": (
        "{arm} hat {n} Achsen: seine Düse neigt sich {t} um bis zu {n2} Grad anders, als sie gehalten werden soll"
    ),
    "at {n} % of the path": "bei {n} % der Bahn",
    "{arm} has no hull: nothing would keep it from touching itself, the table or the part: give its limits file a "
    "[hull] with capsules, or say in the workstation's configuration that collisions are not checked": (
        "{arm} hat keine Hülle: nichts hielte ihn davon ab, sich selbst, den Tisch oder das Teil zu berühren: seiner "
        "Grenzdatei [hull] mit Kapseln geben oder in der Konfiguration der Station sagen, dass Kollisionen nicht "
        "geprüft werden"
    ),
    "constant {n} mm/s is impossible: {t}: lower the speed, or give a blend radius": (
        "konstante {n} mm/s sind unmöglich: {t}: Geschwindigkeit senken oder Ecken runden"
    ),
    # while it runs
    "the nozzle was {n} mm from where it was sent, {n2} mm are allowed": (
        "die Düse war {n} mm von ihrem Soll, {n2} mm sind erlaubt"
    ),
    "the nozzle left the skill's tube: {n} sigma, {n2} are allowed": (
        "die Düse verließ den Schlauch der Fertigkeit: {n} Sigma, {n2} sind erlaubt"
    ),
    "{user} pressed Stop motion at the panel (button)": "{user} hat am Panel „Bewegung stoppen“ gedrückt",
    "{user} pressed Stop motion at the panel (Esc)": "{user} hat am Panel Esc gedrückt",
    "the arm was closed": "der Arm wurde getrennt",
    "the run was cancelled": "der Lauf wurde abgebrochen",
    "{user} paused the job": "{user} hat den Auftrag pausiert",
    "{user} aborted the job": "{user} hat den Auftrag abgebrochen",
    "{user} pressed the protective stop": "{user} hat den Schutzhalt ausgelöst",
    "stopped: {t}": "angehalten: {t}",
    "the run ended without a result": "der Lauf endete ohne Ergebnis",
    "the job ended without a result": "der Auftrag endete ohne Ergebnis",
    "the server stopped": "der Server hielt an",
    "its trace could not be stored": "die Aufzeichnung des Laufs ließ sich nicht speichern",
    "the arm's process ended ({t}): the arm's position is unknown until it is reset": (
        "der Prozess des Arms endete ({t}): die Position des Arms ist bis zum Quittieren unbekannt"
    ),
    "the queue was held before the arm moved: ask for the job again": (
        "die Warteschlange wurde angehalten, bevor der Arm sich bewegte: Auftrag erneut erteilen"
    ),
    "it went on although it is paused": "er lief weiter, obwohl er pausiert ist",
    "the arm of {x} is away from home: send it home first (GoHome)": (
        "der Arm von {x} steht nicht in Grundstellung: zuerst zum Start fahren (GoHome)"
    ),
    "killed by {x}": "beendet durch {x}",
    "exit status {n}": "Status {n}",
    "PyBullet did not start within {n} s": "PyBullet startete nicht innerhalb von {n} s",
    # what the arm refuses
    "{arm} is {t}: it runs one motion at a time": "{arm}: {t}; es läuft eine Bewegung zur Zeit",
    "{arm} stands in a protective stop: reset it first": "{arm} steht im Schutzhalt: zuerst quittieren",
    "{arm} is not connected: open it first": "{arm} ist nicht verbunden: zuerst verbinden",
    "{arm}'s position is unknown ({t}): reset it first": (
        "die Position von {arm} ist unbekannt ({t}): zuerst quittieren"
    ),
    "{arm} does not stand where the plan begins: joint {n} is {n2} degrees away: move it home first": (
        "{arm} steht nicht am Anfang des Plans: Gelenk {n} ist {n2} Grad entfernt: zuerst zum Start fahren"
    ),
    "the plan was made for another arm ({a}), this is {b}": "der Plan gilt für einen anderen Arm ({a}), dies ist {b}",
    "the plan holds NaN or infinity: nothing has moved": "der Plan enthält NaN oder unendlich: nichts hat sich bewegt",
    "the plan has been changed since it was checked: its digest differs": (
        "der Plan wurde nach der Prüfung verändert: seine Prüfsumme weicht ab"
    ),
    "override is {n} %: it has to be from {n2} % to 100 %; pause to stand still": (
        "der Geschwindigkeitsanteil ist {n} %: erlaubt ist {n2} % bis 100 %; zum Stillstehen pausieren"
    ),
    "{arm} is not paused": "{arm} ist nicht pausiert",
    "{arm} is {t}: stop it before a reset": "{arm}: {t}; vor dem Quittieren stoppen",
    "{arm} runs nothing: there is nothing to {t}": "bei {arm} läuft nichts: es gibt nichts zum {t}",
    "pause": "Pausieren",
    "resume": "Fortsetzen",
    "stop": "Anhalten",
    "idle": "in Ruhe",
    "running": "läuft",
    "paused": "pausiert",
    "stopping": "hält an",
    "closed": "kein Kontakt",
    # job orders
    "a job order has another state": "ein Auftrag hat einen anderen Zustand",
    "{name} has no job order {x}": "{name} hat keinen Auftrag {x}",
    "{user} paused the job order": "{user} hat den Auftrag pausiert",
    "{user} stopped the job order": "{user} hat den Auftrag angehalten",
    "{user} took the job order back": "{user} hat den Auftrag zurückgenommen",
    "job order {x} is {y}: only a run is stopped": "Auftrag {x} ist {y}: nur ein Lauf wird angehalten",
    "JobOrderID is empty": "JobOrderID ist leer",
    "{n} orders have not ended": "{n} Aufträge sind nicht zu Ende",
    "{n} work masters are named: it has to be one": "{n} WorkMaster sind genannt: es muss einer sein",
    "{x} is to start at {y}": "{x} soll um {y} beginnen",
    "{x} is another order's id": "{x} ist die Kennung eines anderen Auftrags",
    "{x} is {y}: an order is one run": "{x} ist {y}: ein Auftrag ist ein Lauf",
    "{x} is {y}: that is of the wrong kind": "{x} ist {y}: das ist von der falschen Art",
    "{name} has no parameter {x}": "{name} hat keinen Parameter {x}",
    "the arm of {name} waits for a reset: {t}": "der Arm von {name} wartet auf das Quittieren: {t}",
    "the arm of {name} does not answer: {t}": "der Arm von {name} antwortet nicht: {t}",
    "the way to the start is not free: {t}": "der Weg zum Start ist nicht frei: {t}",
    "the arm of {arm} is locked by {user} ({client}): ask them to release it": (
        "der Arm von {arm} ist von {user} gesperrt ({client}): um Freigabe bitten"
    ),
}
