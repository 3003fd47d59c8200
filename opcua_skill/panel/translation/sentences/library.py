"""What server, library and jobs refuse or tell; and what goes wrong between panel and server."""

LIBRARY = {
    "the list of jobs": "die Liste der Aufträge",
    "there is no workstation {x} on this server: it has {x2}": (
        "an diesem Server gibt es keinen Arbeitsplatz {x}: er hat {x2}"
    ),
    "as many checks as may wait do, {n}: try again when one has ended": (
        "es warten so viele Prüfungen, wie dürfen, {n}: noch einmal versuchen, wenn eine fertig ist"
    ),
    # the client's frame around the server's sentence
    "{method} was refused: {t} [{status}]": "{method} wurde abgelehnt: {t} [{status}]",
    "{method} was refused: {t} (argument {argument}) [{status}]": (
        "{method} wurde abgelehnt: {t} (Argument {argument}) [{status}]"
    ),
    "{url}: {t}": "{url}: {t}",
    "{url} does not let {user} in: {t} [{status}]": "{url} lässt {user} nicht herein: {t} [{status}]",
    "the user name or the password is wrong": "Benutzername oder Passwort ist falsch",
    "the server does not accept this way of signing in": "der Server nimmt diese Art der Anmeldung nicht an",
    "the server does not trust this client's certificate yet": (
        "der Server vertraut dem Zertifikat dieses Panels noch nicht"
    ),
    "the server does not accept this client's certificate": "der Server nimmt das Zertifikat dieses Panels nicht an",
    "this client's certificate has expired or is not valid yet": (
        "das Zertifikat dieses Panels ist abgelaufen oder noch nicht gültig"
    ),
    "this client's certificate names another application": "das Zertifikat dieses Panels nennt eine andere Anwendung",
    "the server has no session left": "der Server hat keine Sitzung mehr frei",
    "the server has no connection left": "der Server hat keine Verbindung mehr frei",
    "{t}; the server's log has the command that lets it in (certificates trust); here it is kept in {file}": (
        "{t}; im Protokoll des Servers steht der Befehl, der es zulässt (certificates trust); hier liegt es in {file}"
    ),
    "no OPC UA server answers at {url}: is it running? ({x})": (
        "kein OPC-UA-Server antwortet unter {url}: läuft er? ({x})"
    ),
    "the server at {url} is not an opcua-skill server": "der Server unter {url} ist kein opcua-skill-Server",
    "the connection to {url} broke: {x}": "die Verbindung zu {url} brach ab: {x}",
    "the connection to {url} broke while signing in": "die Verbindung zu {url} brach bei der Anmeldung ab",
    "no connection to {url}: {t}": "keine Verbindung zu {url}: {t}",
    "the server at {url} has ended the session of {user}": "der Server unter {url} hat die Sitzung von {user} beendet",
    "too many wrong passwords at this browser: try again in {n} s": (
        "zu viele falsche Passwörter an diesem Browser: in {n} s wieder versuchen"
    ),
    "connecting": "wird aufgebaut",
    "{method} got no answer from {url}: {x}": "{method} bekam keine Antwort von {url}: {x}",
    "no answer within {n} s": "keine Antwort innerhalb von {n} s",
    "fault in the panel: {x}": "Störung im Panel: {x}",
    "fault inside, found in the log as {x}": "Störung im Server, im Log unter {x}",
    "job {job} is still {t} after {n} s ({n2}% done)": "Auftrag {job} nach {n} s: noch {t} ({n2} % erledigt)",
    # rights and calls
    "the role {role} may not call {method}": "die Rolle {role} darf {method} nicht aufrufen",
    "the role {role} may not run in {t} mode": "die Rolle {role} darf nicht in diesem Modus ausführen: {t}",
    "{method} cannot be called now": "{method} kann jetzt nicht aufgerufen werden",
    "{method} took longer than {n} s": "{method} dauerte länger als {n} s",
    "{method} took longer than {n} s and was ended": "{method} dauerte länger als {n} s und wurde beendet",
    "{arguments} of {method} has the wrong type": "{arguments} von {method} hat den falschen Typ",
    "the worker process died while it was {x}; a new one is started, try again": (
        "der Rechenprozess brach ab ({x}); ein neuer wird gestartet, noch einmal versuchen"
    ),
    # what a call may cost, and a library that cannot be used
    "a path of {n} s has {n2} samples at steps of {n3} s, {n4} are allowed: take steps of at least {n5} s": (
        "ein Weg von {n} s hat {n2} Abtastwerte bei Schritten von {n3} s, {n4} sind erlaubt: Schritte von mindestens "
        "{n5} s nehmen"
    ),
    "the answer would have {n} bytes, {n2} are allowed: ask for less at once": (
        "die Antwort hätte {n} Bytes, {n2} sind erlaubt: weniger auf einmal abfragen"
    ),
    "the document has {n} characters, {n2} are allowed": "das Dokument hat {n} Zeichen, {n2} sind erlaubt",
    "another program holds the library's database locked: nothing was stored, try again when it has let go": (
        "ein anderes Programm sperrt die Datenbank der Bibliothek: nichts wurde gespeichert, noch einmal versuchen, "
        "wenn es sie freigegeben hat"
    ),
    "the library's database server cannot be reached: nothing was stored, try again when it is there again": (
        "der Datenbankserver der Bibliothek ist nicht erreichbar: nichts wurde gespeichert, noch einmal versuchen, "
        "wenn er wieder da ist"
    ),
    "the library's disk is full: nothing was stored, free space on it and try again": (
        "der Datenträger der Bibliothek ist voll: nichts wurde gespeichert, Platz schaffen und noch einmal versuchen"
    ),
    "database is locked": "die Datenbank ist gesperrt",
    "{n} entries were lost here: they could not be written, and more than {n2} waited": (
        "{n} Einträge gingen hier verloren: sie konnten nicht geschrieben werden, und mehr als {n2} warteten"
    ),
    "{n} more refusals of {x} were counted and not recorded one by one": (
        "{n} weitere Ablehnungen von {x} wurden gezählt und nicht einzeln aufgezeichnet"
    ),
    "{n} lines of the log were dropped: too many came": "{n} Zeilen des Logs fielen weg: es kamen zu viele",
    "another program holds the library's database locked": "ein anderes Programm sperrt die Datenbank der Bibliothek",
    "the library's database server cannot be reached": "der Datenbankserver der Bibliothek ist nicht erreichbar",
    "the library cannot be written: its disk is full": "die Bibliothek ist nicht beschreibbar: Datenträger voll",
    "the disk of the data folder is full: free space on it": "der Datenträger der Daten ist voll: Platz schaffen",
    "the library does not answer": "die Bibliothek antwortet nicht",
    "the audit trail cannot be written": "das Protokoll kann nicht geschrieben werden",
    "the library cannot be written": "in die Bibliothek kann nicht geschrieben werden",
    "the data folder cannot be reached": "der Datenordner ist nicht erreichbar",
    "{x} has {n} samples, {n2} were named": "{x} hat {n} Messpunkte, genannt waren {n2}",
    "{x} has samples 0 to {n}, {n2} were named": "{x} hat Messpunkte 0 bis {n}, genannt waren {n2}",
    "its path cannot be worked out: {x}": "sein Weg lässt sich nicht berechnen: {x}",
    "duration is {n} s: it has to be at most {n2} s": "die Dauer ist {n} s: höchstens {n2} s sind erlaubt",
    "timeStep is {n} s: that makes {n2} samples, {n3} are allowed": (
        "der Zeitschritt ist {n} s: das gibt {n2} Abtastwerte, {n3} sind erlaubt"
    ),
    "its path has {x} that are not finite numbers: means and covariances do not fit together": (
        "sein Weg hat Werte, die keine endlichen Zahlen sind ({x}): Mittelwerte und Kovarianzen passen nicht zusammen"
    ),
    "the times along its path do not rise: means and covariances do not fit together": (
        "die Zeiten entlang seines Weges steigen nicht: Mittelwerte und Kovarianzen passen nicht zusammen"
    ),
    "its path goes {n} m away: positions are in metres, at most {n2} from the origin": (
        "sein Weg führt {n} m weit weg: Positionen sind in Metern, höchstens {n2} vom Ursprung"
    ),
    # things and their states
    "there is no {t} {name}: look up the ones there are and check the spelling": (
        "{t} {name} gibt es nicht: nachsehen, was es gibt, und die Schreibweise prüfen"
    ),
    "there is no recording {name}: look up the ones there are and check the spelling": (
        "die Aufzeichnung {name} gibt es nicht: nachsehen, was es gibt, und die Schreibweise prüfen"
    ),
    "skill": "Fertigkeit",
    "recipe": "Rezept",
    "job": "Auftrag",
    "trace": "Aufzeichnung des Laufs",
    "user": "Benutzer",
    "recordings": "Aufnahmen",
    "workstation": "Arbeitsplatz",
    "demonstration": "Vorführung",
    "{t} is {t2}: {t3}": "{t} – {t2}: {t3}",
    "{t} is {x}: {t3}": "{t} ist {x}: {t3}",
    "{name} version {n}": "{name} Version {n}",
    "job {x}": "Auftrag {x}",
    "recording {x}": "Aufzeichnung {x}",
    "the recorder of {x}": "der Rekorder von {x}",
    "the arm of {x}": "der Arm von {x}",
    "the queue of {x}": "die Warteschlange von {x}",
    "held anew": "erneut angehalten",
    "stopped meanwhile": "inzwischen gestoppt",
    "look first, then ask again": "zuerst nachsehen, dann noch einmal verlangen",
    "look first, then release it": "zuerst nachsehen, dann freigeben",
    "busy with job {x}": "beschäftigt mit Auftrag {x}",
    "on its way home": "auf dem Weg zum Start",
    "it has to be at rest": "er muss in Ruhe sein",
    "it has to be paused": "er muss pausiert sein",
    "nothing becomes {t}": "nichts wird {t}",
    "only one that is {t} can become {t2}": "nur aus {t} wird {t2}",
    "{t} or {t2}": "{t} oder {t2}",
    "only one that is Approved can be deployed": "nur eine freigegebene Version kann bereitgestellt werden",
    "only what is deployed there can be withdrawn": "nur was dort bereitgestellt ist, kann zurückgezogen werden",
    "not deployed on {x}": "nicht bereitgestellt auf {x}",
    "it has to be {t}": "erlaubt ist: {t}",
    "it has to be idle": "er muss in Ruhe sein",
    "it has to be running": "er muss laufen",
    "at its end": "am Ende",
    "running or paused": "laufend oder pausiert",
    "under way": "unterwegs",
    "the digest given is not that of {name} version {n}: read the version again and decide on that": (
        "die angegebene Prüfsumme ist nicht die von {name} Version {n}: Version neu lesen und darüber entscheiden"
    ),
    "{user} taught {name} version {n} and cannot approve it: ask a second engineer": (
        "{user} hat {name} Version {n} gezeigt und kann sie nicht freigeben: einen zweiten Ingenieur bitten"
    ),
    "{user} {t} {name} version {n} and cannot approve it: ask a second engineer": (
        "{user} kann {name} Version {n} nicht freigeben ({t}): einen zweiten Ingenieur bitten"
    ),
    "has approved": "hat schon freigegeben",
    "contributed to what became": "hat an dem mitgewirkt, woraus sie entstand",
    # what keeps a server from starting
    "it is empty (0 bytes)": "sie ist leer (0 Byte)",
    "restore it from a backup": "aus einer Sicherung zurückholen",
    "restore it from a backup, or delete it to begin with an empty library": (
        "aus einer Sicherung zurückholen oder löschen, um mit einer leeren Bibliothek zu beginnen"
    ),
    "restore it from a backup, or move {x} away to begin with an empty library": (
        "aus einer Sicherung zurückholen oder {x} beiseite legen, um mit einer leeren Bibliothek zu beginnen"
    ),
    "there is no such file": "die Datei gibt es nicht",
    "check the name of the data folder (--data)": "den Namen des Datenordners prüfen (--data)",
    "it is missing though {x} is there": "sie fehlt, obwohl {x} da ist",
    "its table {x} is missing": "ihre Tabelle {x} fehlt",
    "its table {x} lacks {y}": "ihrer Tabelle {x} fehlt {y}",
    "the private key {x} has mode {y}, others may read it: chmod 600 {z}, and if somebody has read it, move key and"
    " certificate away to have new ones made": (
        "der private Schlüssel {x} hat die Rechte {y}, andere können ihn lesen: chmod 600 {z}, und falls ihn jemand"
        " gelesen hat, Schlüssel und Zertifikat beiseite legen, damit neue entstehen"
    ),
    "{n} sessions have an id that begins with {x}": "{n} Sitzungen haben eine Kennung, die mit {x} beginnt",
    "{y} sessions have an id that begins with {x}": "{y} Sitzungen haben eine Kennung, die mit {x} beginnt",
    "there is no session {x}: look up the ones there are": "die Sitzung {x} gibt es nicht: nachsehen, welche es gibt",
    "{x} is served already by {y}: stop that server, or name another folder with --data": (
        "{x} wird schon bedient von {y}: jenen Server anhalten oder mit --data einen anderen Ordner nennen"
    ),
    "the library {x} is missing, though it was served last on {y}: restore it from a backup, or delete {z} to begin"
    " with an empty library": (
        "die Bibliothek {x} fehlt, obwohl sie zuletzt am {y} bedient wurde: aus einer Sicherung zurückholen oder {z}"
        " löschen, um mit einer leeren Bibliothek zu beginnen"
    ),
    "the user {x} has the role {y}, which is none of {z}: opcua-skill users role {x2} ROLE, or restore the library"
    " from a backup": (
        "der Benutzer {x} hat die Rolle {y}, die keine von {z} ist: opcua-skill users role {x2} ROLE, oder die"
        " Bibliothek aus einer Sicherung zurückholen"
    ),
    "{user} imported {name} version {n} and cannot approve it: ask a second engineer": (
        "{user} hat {name} Version {n} eingespielt und kann sie nicht freigeben: einen zweiten Ingenieur bitten"
    ),
    "{user} contributed to what became {name} version {n} and cannot approve it: ask a second engineer": (
        "{user} hat an dem mitgewirkt, woraus {name} Version {n} entstand, und kann sie nicht freigeben: einen zweiten"
        " Ingenieur bitten"
    ),
    "{user} has approved {name} version {n} and cannot approve it: ask a second engineer": (
        "{user} hat {name} Version {n} schon freigegeben: einen zweiten Ingenieur bitten"
    ),
    "recording {name} belongs to {user}: ask them or an engineer": (
        "die Aufzeichnung {name} gehört {user}: dort oder einen Ingenieur fragen"
    ),
    "the {t} {name} exists already: {t2}": "{t} {name} gibt es schon: {t2}",
    "choose another name": "anderen Namen wählen",
    "a job has one": "ein Auftrag hat eine",
    "it belongs to {x}, choose another id": "es gehört zu {x}, anderen Namen wählen",
    "remove that one first or choose another name": "erst entfernen oder anderen Namen wählen",
    "{t} is in use, {t2}: {t3}": "{t} wird gebraucht, {t2}: {t3}",
    "recipe {x}": "Rezept {x}",
    "as the default of {x}": "als Vorgabe von {x}",
    "change it instead": "stattdessen ändern",
    "by job {x}": "von Auftrag {x}",
    "wait for its end or abort it": "Ende abwarten oder abbrechen",
    "deployed on {x}": "bereitgestellt auf {x}",
    "withdraw it there first": "dort zuerst zurückziehen",
    "the library {x} cannot be used, {y}: {t}": "die Bibliothek {x} ist nicht benutzbar, {y}: {t}",
    "what is stored of {t} cannot be read, {y}: restore it from a backup": (
        "was zu {t} gespeichert ist, lässt sich nicht lesen, {y}: aus einer Sicherung wiederherstellen"
    ),
    "write it as sqlite:///path/to/file or name a file": (
        "als sqlite:///pfad/zur/datei schreiben oder eine Datei nennen"
    ),
    "name a file in a folder that this user may write": "Datei in einem Ordner mit Schreibrecht nennen",
    "{x} is none of sqlite, postgresql+asyncpg": "{x} ist keines von sqlite, postgresql+asyncpg",
    "the connection broke while it was stored, maybe it is": (
        "die Verbindung brach beim Speichern ab, vielleicht ist es gespeichert"
    ),
    "it has no tables yet": "es hat noch keine Tabellen",
    "check its name, or start a server on it first": "den Namen prüfen, oder zuerst einen Server darauf starten",
    "look up what is there before trying again": "nachsehen, was da ist, bevor es noch einmal versucht wird",
    "the database role {x} owns the library's tables and can drop what guards them": (
        "der Datenbankbenutzer {x} besitzt die Tabellen der Bibliothek und kann entfernen, was sie schützt"
    ),
    "name a file, or a database whose driver is installed": "Datei nennen oder Datenbank mit installiertem Treiber",
    # jobs
    "{name} is not deployed on {where}: deploy it first": (
        "{name} ist auf {where} nicht bereitgestellt: zuerst bereitstellen"
    ),
    "{name} version {n} is not deployed on {where} any more": (
        "{name} Version {n} ist auf {where} nicht mehr bereitgestellt"
    ),
    "{name} version {n} is {t} by now": "{name} Version {n} ist inzwischen {t}",
    "recipe {x} is for version {n}, deployed is version {n2}": (
        "Rezept {x} ist für Version {n}, bereitgestellt ist Version {n2}"
    ),
    "{name} version {n} is {t}: only an approved one runs": "{name} Version {n} ist {t}: nur eine freigegebene läuft",
    "{where} lacks the atomic skill {x}": "{where} kann den Elementarschritt {x} nicht",
    "as many jobs as may wait do, {n}: try again when one has ended": (
        "es warten so viele Aufträge, wie dürfen, {n}: noch einmal, wenn einer beendet ist"
    ),
    "as many learning jobs as may wait do, {n}: try again when one has ended": (
        "es warten so viele Lernaufträge, wie dürfen, {n}: noch einmal, wenn einer beendet ist"
    ),
    "learning goes on as job {x}": "das Lernen geht als Auftrag {x} weiter",
    "there is no mode {x}: 0 is simulation, 1 test, 2 production": (
        "es gibt keinen Modus {x}: 0 ist Simulation, 1 Test, 2 Produktion"
    ),
    "there is no state {x}: {y}": "es gibt keinen Zustand {x}: {y}",
    # values
    "{field} is {x}: {t}": "{field} ist {x}: {t}",
    "it is a {t}": "erlaubt ist: {t}",
    "text": "Text",
    "number": "Zahl",
    "points of {x}": "Punkte von {x}",
    "its model is not the one its digest names": "ihr Modell ist nicht das ihrer Prüfsumme",
    "it has to be a number": "es muss eine Zahl sein",
    "it has to be {x} or {y}": "erlaubt ist {x} oder {y}",
    "it has to be at least {n} and at most {n2}": "erlaubt ist {n} bis {n2}",
    "it has to be above {n} and at most {n2}": "erlaubt ist mehr als {n} bis {n2}",
    "it has to be at least {n}": "mindestens {n} ist nötig",
    "it has to be above {n}": "mehr als {n} ist nötig",
    "it has to be at most {n}": "höchstens {n} ist erlaubt",
    "a parameter is a number or a text": "ein Parameter ist eine Zahl oder ein Text",
    "text must not hold NUL characters or lone surrogates": "der Text enthält Zeichen, die sich nicht speichern lassen",
    "at most {n} characters are allowed, these are {n2}": "höchstens {n} Zeichen sind erlaubt, dies sind {n2}",
    "a name has 1 to {n} characters and no space at either end": (
        "ein Name hat 1 bis {n} Zeichen und kein Leerzeichen am Anfang oder Ende"
    ),
    "a name must not hold '/' or control characters": "ein Name enthält weder '/' noch Steuerzeichen",
    "timing constant_speed needs a speed above 0 and at most 1 m/s": (
        "konstante Geschwindigkeit braucht einen Wert über 0 und höchstens 1 m/s"
    ),
    "x, y and z lie within 10 m of the arm's base": "x, y und z liegen höchstens 10 m vom Armfuß",
    "qx qy qz qw is a unit quaternion (length 1 within 1e-6)": "qx qy qz qw ist ein Einheitsquaternion (Länge 1)",
    "{name} has no such parameter, it has {x}": "{name} hat diesen Parameter nicht, es gibt {x}",
    "say what kind of skill this is, such as Gluing": "Art der Fertigkeit angeben, zum Beispiel Gluing",
    "it lies in 0 to 1": "es liegt in 0 bis 1",
    "it is one of {x}, or empty for any": "es ist eines von {x}, oder leer für alle",
    "write a reason, it is kept with the decision": "Begründung angeben, sie wird mit der Entscheidung aufbewahrt",
    "it is at most {n}; 0 stands for {n2}": "es ist höchstens {n}; 0 steht für {n2}",
    "they have {n} columns, or {n2} with orientation": "sie haben {n} Spalten, oder {n2} mit Orientierung",
    "there are {n}, as many as means": "es sind {n}, so viele wie Mittelwerte",
    "each is {n} by {n2}": "jede ist {n} mal {n2}",
    "each is symmetric": "jede ist symmetrisch",
    "each is positive, along the clock above 0": "jede ist positiv, entlang der Uhr über 0",
    "intervals of phase lie in 0 to 1, in order, apart": "Abschnitte liegen in 0 bis 1, geordnet, getrennt",
    "each has a name of its own": "jede hat einen eigenen Namen",
    "each demonstration has an id of its own": "jede Vorführung hat einen eigenen Namen",
    "they are not options this program knows": "diese Optionen kennt das Programm nicht",
    "they have shape (n, 2) or (n, 3)": "sie haben die Form (n, 2) oder (n, 3)",
    "there are as many as times, {n}": "es sind so viele wie Zeiten, {n}",
    "of a job only {x} may change": "an einem Auftrag darf sich nur ändern: {x}",
    "its shape is {x}: times by columns": "seine Form ist {x}: Zeiten mal Spalten",
    "format {x} is not offered: json is": "das Format {x} gibt es nicht, json gibt es",
    "{x} has samples 0 to {n}, {n2} was named": "{x} hat Messpunkte 0 bis {n}, genannt war {n2}",
    "there are two entries for demonstration {x}": "es gibt zwei Einträge für Vorführung {x}",
    "TimeStep is {n} s: it has to be 0, or 0.0005 to 1": "TimeStep ist {n} s: erlaubt ist 0, oder 0,0005 bis 1",
    "no samples were named: give at least one index": "es war kein Messpunkt genannt: mindestens einen angeben",
    "FilterWindow and TimeStep have to be finite": "FilterWindow und TimeStep müssen endlich sein",
    "{n} demonstrations were sent, {n2} are allowed in one call": (
        "{n} Vorführungen waren es, {n2} sind in einem Aufruf erlaubt"
    ),
    "a demonstration has {n} samples, {n2} are allowed": "eine Vorführung hat {n} Messpunkte, {n2} sind erlaubt",
    "a demonstration has {n} samples, {n2} are allowed: record fewer a second": (
        "eine Vorführung hat {n} Messpunkte, {n2} sind erlaubt: weniger je Sekunde aufnehmen"
    ),
    "these demonstrations make a message of {n} MB, the server takes {n2} MB: send fewer of them, or record fewer "
    "samples a second": (
        "diese Vorführungen ergeben {n} MB, der Server nimmt {n2} MB: weniger senden oder weniger je Sekunde aufnehmen"
    ),
    # recorder
    "Trigger is a Boolean": "Trigger ist ein Wahrheitswert",
    "nothing is being recorded: start a recording first": (
        "es wird nichts aufgezeichnet: zuerst eine Aufzeichnung beginnen"
    ),
    "nothing is recorded on {x}: start a recording": "auf {x} ist nichts aufgezeichnet: eine Aufzeichnung beginnen",
    "Dimension is {x}: it has to be 2 or 3": "Dimension ist {x}: erlaubt ist 2 oder 3",
    "finished": "beendet",
    "recording for {x}": "zeichnet für {x} auf",
    "finish or discard that recording first": "diese Aufzeichnung zuerst beenden oder verwerfen",
    "start another one": "eine neue beginnen",
    "fed by {x}": "gespeist von {x}",
    "start one of your own": "eine eigene beginnen",
    "still open": "noch offen",
    "finish it first": "zuerst beenden",
    "still being shown": "wird noch gezeigt",
    "release the push button first": "zuerst den Taster loslassen",
    "a recording holds {n} samples: finish it and start another one": (
        "eine Aufzeichnung fasst {n} Messpunkte: beenden und eine neue beginnen"
    ),
    "{n} samples were sent, {n2} are allowed in one append": "{n} Messpunkte waren es, {n2} sind auf einmal erlaubt",
    "After is {n}, the recording has {n2} samples": "After ist {n}, die Aufzeichnung hat {n2} Messpunkte",
    "{n} times need {n2} values of a recording in {n3} dimensions: {n4}": (
        "{n} Zeiten brauchen {n2} Werte in {n3} Dimensionen: {n4}"
    ),
    "{n} times need {n2} triggers or none, {n3} were sent": (
        "{n} Zeiten brauchen {n2} Tasterwerte oder keine, {n3} waren es"
    ),
    "time {n} of the append is NaN or infinite": "Zeit {n} ist NaN oder unendlich",
    "time {n} of the append does not come after the one before: nothing taken": (
        "Zeit {n} kommt nicht nach der davor: nichts übernommen"
    ),
    "the append begins {n} s after the recording's start, which has come to {n2} s: times have to rise from append to "
    "append": "die Messpunkte beginnen bei {n} s, die Aufzeichnung ist schon bei {n2} s: Zeiten müssen steigen",
    "the position of sample {n} is NaN or infinite: leave out what was not seen": (
        "die Position von Messpunkt {n} ist NaN oder unendlich: auslassen, was nicht gesehen wurde"
    ),
    "a position is {n} m away from the origin: positions are in metres, up to 20 m": (
        "eine Position ist {n} m vom Ursprung: Positionen sind in Metern, bis 20 m"
    ),
    "the samples before had orientations: send them with all or with none": (
        "die Messpunkte davor hatten Orientierungen: mit allen oder mit keinem senden"
    ),
    "the samples before had no orientations: send them with all or with none": (
        "die Messpunkte davor hatten keine Orientierungen: mit allen oder mit keinem senden"
    ),
    "orientations need a recording in three dimensions": (
        "Orientierungen brauchen eine Aufzeichnung in drei Dimensionen"
    ),
    "{n} times need {n2} values, {n3} were sent": "{n} Zeiten brauchen {n2} Werte, {n3} waren es",
    "the quaternion x y z w of sample {n} has not length 1": (
        "das Quaternion x y z w von Messpunkt {n} hat nicht die Länge 1"
    ),
    "a recording holds {n} demonstrations: finish it, or discard some of them": (
        "eine Aufzeichnung fasst {n} Vorführungen: beenden oder einige verwerfen"
    ),
    "this demonstration has {n} samples, {n2} are allowed: release the button, or record fewer samples a second": (
        "diese Vorführung hat {n} Messpunkte, {n2} sind erlaubt: Taster loslassen oder weniger je Sekunde aufnehmen"
    ),
    "a press at {n} s of {n2} ms, {n3} samples, is no demonstration": (
        "ein Tastendruck bei {n} s von {n2} ms, {n3} Messpunkte, ist keine Vorführung"
    ),
    # events
    "{name} version {n} is {t}, by {user}": "{name} Version {n}: {t}, von {user}",
    "{name} version {n} deployed on {where} by {user}": "{name} Version {n} auf {where} bereitgestellt von {user}",
    "{name} version {n} withdrawn from {where} by {user}": "{name} Version {n} von {where} zurückgezogen von {user}",
    "job {x} of {name} is {t}": "Auftrag {x} von {name}: {t}",
    "job {x} of {name} is {t}: {t2}, {t3}": "Auftrag {x} von {name}: {t}: {t2}, {t3}",
    "job {x} of {name} is {t}: {t2}": "Auftrag {x} von {name}: {t}: {t2}",
    "protective stop on {where}: {t}": "Schutzhalt an {where}: {t}",
    "{method} by {user}: done": "{method} von {user}: erledigt",
    "{method} by {user}: {status}: {t}": "{method} von {user}: {status}: {t}",
    "connections without encryption are accepted": "Verbindungen ohne Verschlüsselung werden angenommen",
    "anonymous sessions are accepted, as observers": "anonyme Sitzungen werden angenommen, als Beobachter",
    "every client certificate is trusted": "jedem Zertifikat eines Clients wird vertraut",
}
