"""What the readers say of files: which file, which line, what to do."""

FILES = {
    "{file}, line {n}: {t}; {t2}": "{file}, Zeile {n}: {t}; {t2}",
    "{file}: {t}; {t2}": "{file}: {t}; {t2}",
    "{name}: {n} of {n2} samples were not seen, the longest gap is {n3} s": (
        "{name}: {n} von {n2} Messpunkten wurden nicht gesehen, die längste Lücke ist {n3} s"
    ),
    "files that end in {x} are not known": "Dateien auf {x} sind nicht bekannt",
    "its name does not end in a format": "der Name endet nicht auf ein Format",
    "save it as CSV; these can be read: {x}": "als CSV speichern; lesbar sind: {x}",
    "these can be read: {x}": "lesbar sind: {x}",
    "unpack it; these can be read: {x}": "entpacken; lesbar sind: {x}",
    "only {x} reads files that end in {y}": "nur {x} liest Dateien auf {y}",
    "export it from there as {x}": "von dort als {x} exportieren",
    "its reader crashed": "der Leser stürzte ab",
    "its reader failed: {t}": "ihr Leser scheiterte: {t}",
    "ask whoever wrote that reader": "fragen Sie, wer diesen Leser geschrieben hat",
    "the file is damaged: export it again": "die Datei ist beschädigt: neu exportieren",
    "it takes more than {n} MB of memory to read": "sie zu lesen braucht mehr als {n} MB Speicher",
    "export it again, or cut out what is needed": "neu exportieren, oder ausschneiden, was nötig ist",
    "cut out what is needed": "ausschneiden, was nötig ist",
    "it unpacks to more than {n} MB": "sie entpackt sich auf mehr als {n} MB",
    "it is no file but a folder, a pipe or a device": (
        "es ist keine Datei, sondern ein Ordner, eine Pipe oder ein Gerät"
    ),
    "name a file": "eine Datei nennen",
    "it is a folder": "es ist ein Ordner",
    "name the files in it": "die Dateien darin nennen",
    # tables
    "export it again": "neu exportieren",
    "export it again, it may have been cut off": "neu exportieren, sie ist vielleicht abgeschnitten",
    "the file ends before its table begins": "die Datei endet vor ihrer Tabelle",
    "column {n} holds {x}, which is not a number": "Spalte {n} enthält {x}, das ist keine Zahl",
    "mend the cell or delete the line": "Zelle berichtigen oder Zeile löschen",
    "export it without separators between thousands": "ohne Trennzeichen zwischen Tausendern exportieren",
    "write times as seconds from the start, as in t_s": "Zeiten als Sekunden seit Beginn schreiben, wie in t_s",
    "write the unit into the name of the column, as in x_mm": "Einheit in den Spaltennamen schreiben, wie in x_mm",
    "column {n} holds {x} and column {n2} of line {n3} {y}: a comma and a point cannot both be decimal": (
        "Spalte {n} enthält {x} und Spalte {n2} von Zeile {n3} {y}: Komma und Punkt können nicht beide dezimal sein"
    ),
    "its cells are separated by {x}": "die Zellen sind durch {x} getrennt",
    "it has {n} columns": "sie hat {n} Spalten",
    "cut out what is needed: {n} at most": "ausschneiden, was nötig ist: höchstens {n}",
    "a quote is opened and not closed": "ein Anführungszeichen wird geöffnet und nicht geschlossen",
    "close it, or take the quotes out": "schließen oder Anführungszeichen weglassen",
    "a line with quotes has {n} characters": "eine Zeile mit Anführungszeichen hat {n} Zeichen",
    "take the quotes out": "Anführungszeichen weglassen",
    "use one of m, cm, mm: an inch has 25.4 mm, a foot 304.8": (
        "m, cm oder mm verwenden: ein Zoll hat 25,4 mm, ein Fuß 304,8"
    ),
    "it is a spreadsheet or another packed file": "es ist eine Tabellendatei oder anders gepackt",
    "save it as CSV": "als CSV speichern",
    "it is no text file": "es ist keine Textdatei",
    "export it again as CSV": "als CSV neu exportieren",
    "it holds bytes that are no text in UTF-8": "sie enthält Bytes, die kein Text in UTF-8 sind",
    "save it as UTF-8": "als UTF-8 speichern",
    "it has {n} MB": "sie hat {n} MB",
    "cut out what is needed: {n} MB at most": "ausschneiden, was nötig ist: höchstens {n} MB",
    "check the name and the right to read it": "Name und Leserecht prüfen",
    "it is empty": "sie ist leer",
    "{name} has {n} samples": "{name} hat {n} Messpunkte",
    "at least 2 are needed: record it again": "mindestens 2 sind nötig: noch einmal aufnehmen",
    "{name} has no position at all": "{name} hat gar keine Position",
    "choose a marker that was seen": "einen Marker wählen, der gesehen wurde",
    "{name} reaches {n} m from the origin": "{name} reicht {n} m vom Ursprung",
    "name the unit of its positions, as in x_mm, or choose it when reading": (
        "Einheit der Positionen nennen, wie in x_mm, oder beim Lesen wählen"
    ),
    "the times of {name} do not rise": "die Zeiten von {name} steigen nicht",
    "export it again with its times": "mit Zeiten neu exportieren",
    "name the columns on the first line, for example t_s,x_mm,y_mm,z_mm,trigger": (
        "Spalten in der ersten Zeile nennen, zum Beispiel t_s,x_mm,y_mm,z_mm,trigger"
    ),
    "{t}; known names: {x}": "{t}; bekannte Namen: {x}",
    "the line has {n} cells, the header {n2}": "die Zeile hat {n} Zellen, die Kopfzeile {n2}",
    "the line has {n} cells of {n2}": "die Zeile hat {n} von {n2} Zellen",
    "mend the line, or delete it if it was cut off": "Zeile berichtigen, oder löschen, wenn sie abgeschnitten ist",
    "there are no samples below the header": "unter der Kopfzeile stehen keine Messpunkte",
    "the first line holds numbers and no names": "die erste Zeile enthält Zahlen und keine Namen",
    "its columns are not separated": "die Spalten sind nicht getrennt",
    "separate them by commas, semicolons or tabs": "durch Komma, Semikolon oder Tabulator trennen",
    "column {n} is called {x}": "Spalte {n} heißt {x}",
    "column {n} is a second {x}": "Spalte {n} ist ein zweites {x}",
    "leave one of them": "eine davon lassen",
    "there is no column {x}": "es gibt keine Spalte {x}",
    "x, y and z have different units": "x, y und z haben verschiedene Einheiten",
    "give them one unit": "eine Einheit für alle",
    "of the quaternion there is only {x}": "vom Quaternion gibt es nur {x}",
    "give qx, qy, qz and qw, or none": "qx, qy, qz und qw angeben, oder keines",
    "the unit of {x} is {y}": "die Einheit von {x} ist {y}",
    "use one of {x}": "eine von {x} verwenden",
    "leave the unit out": "Einheit weglassen",
    "only a part of the position is there": "nur ein Teil der Position ist da",
    "give all of it or none": "ganz angeben oder gar nicht",
    "time {n} does not come after {n2}": "Zeit {n} kommt nicht nach {n2}",
    "frame {n} does not come after {n2}": "Bild {n} kommt nicht nach {n2}",
    "delete or mend the line": "Zeile löschen oder berichtigen",
    "the quaternion {x} has length {n}, not length 1": "das Quaternion {x} hat die Länge {n}, nicht 1",
    "mend or delete the line; the order is qx, qy, qz, qw": (
        "Zeile berichtigen oder löschen; die Reihenfolge ist qx, qy, qz, qw"
    ),
    "of the quaternion a part is missing": "vom Quaternion fehlt ein Teil",
    "mend or delete the line": "Zeile berichtigen oder löschen",
    "its samples are {n} s apart": "die Messpunkte sind {n} s auseinander",
    "name the unit of its times, as in t_ms": "Einheit der Zeiten nennen, wie in t_ms",
    "the trigger is {x}": "der Taster ist {x}",
    "write one of {x}": "eines von {x} schreiben",
    # motion capture
    "the format does not say which axis points up": "das Format sagt nicht, welche Achse nach oben zeigt",
    "choose the up axis: y unless Motive was set to z": "Achse nach oben wählen: y, wenn Motive nicht auf z stand",
    "choose the up axis: x, y or z": "Achse nach oben wählen: x, y oder z",
    "it holds no {t} {x}": "sie enthält keinen {t} {x}",
    "choose one of {x}": "einen wählen von {x}",
    "it holds no {t}s to follow": "sie enthält keinen {t} zum Verfolgen",
    "export or record it with positions": "mit Positionen exportieren oder aufnehmen",
    "it holds {n} {t}s": "sie enthält {n} {t}",
    "{n} {t}s are called {x}": "{n} {t} heißen {x}",
    "name them apart and export again": "verschieden benennen und neu exportieren",
    "marker": "Marker",
    "topic": "Topic",
    "rigid body or marker": "Körper oder Marker",
    "marker or rigid body": "Marker oder Körper",
    "its time does not fit its frame number at {n} frames a second": (
        "die Zeit passt nicht zur Bildnummer bei {n} Bildern je Sekunde"
    ),
    "export the file again": "Datei neu exportieren",
    "it may be cut off: export it again": "sie ist vielleicht abgeschnitten: neu exportieren",
    "only a part of a position is there": "nur ein Teil einer Position ist da",
    "mend or empty it": "berichtigen oder leeren",
    "there are no samples": "es gibt keine Messpunkte",
    "export it again from Motive as CSV": "aus Motive als CSV neu exportieren",
    "Length Units are {x}": "Length Units sind {x}",
    "there is no line that begins with {x}": "es gibt keine Zeile, die mit {x} beginnt",
    "there is no Export Frame Rate": "es gibt keine Export Frame Rate",
    "{x} is {n}": "{x} ist {n}",
    "the lines Type and Name are missing above Frame": "über Frame fehlen die Zeilen Type und Name",
    "X, Y and Z of {x} belong to different bodies": "X, Y und Z von {x} gehören zu verschiedenen Körpern",
    "export it again as TRC": "als TRC neu exportieren",
    "it does not begin with PathFileType": "sie beginnt nicht mit PathFileType",
    "DataRate and Units are missing, or do not stand one below the other": (
        "DataRate und Units fehlen oder stehen nicht untereinander"
    ),
    "rate and unit are {n} and {x}": "Rate und Einheit sind {n} und {x}",
    "below {x} are no columns {y}": "unter {x} stehen keine Spalten {y}",
    "export it again from Nexus as ASCII with trajectories": "aus Nexus als ASCII mit Trajectories neu exportieren",
    "it holds {x} and no trajectories": "sie enthält {x} und keine Trajectories",
    "there is no frame rate": "es gibt keine Bildrate",
    "it has sub frames": "sie hat Sub Frames",
    "export trajectories at their own rate": "Trajectories mit ihrer eigenen Rate exportieren",
    "export it again as C3D": "als C3D neu exportieren",
    "ROS bags need the package rosbags": "ROS-Bags brauchen das Paket rosbags",
    "install opcua-skill[formats]": "opcua-skill[formats] installieren",
    "its head promises {n} markers in {n2} frames, {n3} bytes, the file has {n4}": (
        "der Kopf verspricht {n} Marker in {n2} Bildern, {n3} Bytes, die Datei hat {n4}"
    ),
    "it may be cut off: {t}": "sie ist vielleicht abgeschnitten: {t}",
    "its unit and rate are {x} and {n}": "Einheit und Rate sind {x} und {n}",
    "it names {n} markers and holds {n2}": "sie nennt {n} Marker und enthält {n2}",
    "it cannot be read ({x})": "sie lässt sich nicht lesen ({x})",
    "it cannot be read within {n} s": "sie lässt sich nicht in {n} s lesen",
    "it does not begin as a C3D file": "sie beginnt nicht wie eine C3D-Datei",
    "it is not in Intel format": "sie ist nicht im Intel-Format",
    "save it in Intel format": "im Intel-Format speichern",
    "its head and its parameters name different {x}, {n} and {n2}": (
        "Kopf und Parameter nennen verschiedene {x}, {n} und {n2}"
    ),
    "record it again, or convert it with rosbags-convert": "noch einmal aufnehmen oder mit rosbags-convert wandeln",
    "nothing was recorded on {x}": "auf {x} wurde nichts aufgezeichnet",
    "no message on {x} has a stamp": "keine Nachricht auf {x} hat einen Zeitstempel",
    "let its publisher fill header.stamp and record it again": (
        "header.stamp vom Sender füllen lassen und neu aufnehmen"
    ),
    "message {n} on {x} has the stamp of the one before it and another position": (
        "Nachricht {n} auf {x} hat den Zeitstempel der vorigen und eine andere Position"
    ),
    "message {n} on {x} is stamped {n2} s before the one before it": (
        "Nachricht {n} auf {x} ist {n2} s vor der vorigen gestempelt"
    ),
    "leave it out, or record it again with one publisher and one clock": (
        "auslassen, oder mit einem Sender und einer Uhr neu aufnehmen"
    ),
    "it holds forces or other signals and no markers": "sie enthält Kräfte oder andere Signale und keine Marker",
    "export it with trajectories": "mit Trajectories exportieren",
    "its head says that samples begin at block {n}, in steps of {n2}": (
        "laut Kopf beginnen die Messpunkte bei Block {n}, in Schritten von {n2}"
    ),
    "it says that it holds {x} frames, and has room for {n}": "laut Angabe enthält sie {x} Bilder, Platz ist für {n}",
    "it names {n} markers and has {n2} columns": "sie nennt {n} Marker und hat {n2} Spalten",
    "it holds {x} data and no markers": "sie enthält {x}-Daten und keine Marker",
    "export it again from Qualisys Track Manager as TSV with 3D data": (
        "aus Qualisys Track Manager als TSV mit 3D-Daten neu exportieren"
    ),
    # placing
    "the samples lie {n} mm from one plane (RMS), {n2} mm at most": (
        "die Messpunkte liegen {n} mm von einer Ebene (RMS), höchstens {n2} mm"
    ),
    "{t}; {n} that are no positions of the hand were left out": (
        "{t}; {n}, die keine Positionen der Hand sind, wurden ausgelassen"
    ),
    "{t}, about which it may be turned by {n} degrees; show a wider stroke, or learn them in space": (
        "{t}, um die sie um {n} Grad gedreht sein kann; einen breiteren Strich zeigen oder im Raum lernen"
    ),
    "positions are needed: no marker was seen": "Positionen sind nötig: kein Marker wurde gesehen",
    "one or more are needed, all in two dimensions": "eine oder mehr sind nötig, alle in zwei Dimensionen",
    "one or more are needed, all in three dimensions": "eine oder mehr sind nötig, alle in drei Dimensionen",
    "twice the margin is less than width and height": "der doppelte Rand ist kleiner als Breite und Höhe",
    "they have an extent: these stand still": "sie haben eine Ausdehnung: diese stehen still",
    "they span a plane: these lie on one line": "sie spannen eine Ebene auf: diese liegen auf einer Linie",
}
