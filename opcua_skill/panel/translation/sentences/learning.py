"""What learning says of demonstrations, options and models."""

LEARNING = {
    "the button was pressed {n} times where the others pressed it {n2} times": (
        "der Knopf wurde {n}-mal gedrückt, wo die anderen ihn {n2}-mal drückten"
    ),
    "{t}: draw it again": "{t}: noch einmal zeichnen",
    # verdicts
    "{t1}; {t2}": "{t1}; {t2}",
    "{t1}, {t2}": "{t1}, {t2}",
    "{t1} and {n} more": "{t1} und {n} weitere",
    "{n} of the path: {n2} mm {t} the others": "{n} der Bahn: {n2} mm {t}",
    "above": "über den anderen",
    "below": "unter den anderen",
    "to the right of": "rechts von den anderen",
    "to the left of": "links von den anderen",
    "behind": "hinter den anderen",
    "in front of": "vor den anderen",
    "the same shape drawn elsewhere: {n} mm {t} the others": "dieselbe Form anderswo gezeichnet: {n} mm {t}",
    "the button was pressed {n} times where the others pressed it {n2} times: draw it again": (
        "die Taste wurde {n}-mal gedrückt, bei den anderen {n2}-mal: noch einmal zeichnen"
    ),
    "started at {n} of the path: used from there": "begann bei {n} der Bahn: ab dort verwendet",
    "let go at {n} of the path: used up to there": "losgelassen bei {n} der Bahn: bis dort verwendet",
    "began {n} mm before the others: used from where they begin": (
        "begann {n} mm vor den anderen: ab dort verwendet, wo sie beginnen"
    ),
    "went on {n} mm past where the others end: used up to there": (
        "ging {n} mm weiter als bis dort, wo die anderen enden: bis dort verwendet"
    ),
    "{n} mm": "{n} mm",
    "went over {t} again at {n2} of the path": "fuhr {t} noch einmal, bei {n2} der Bahn",
    "took a way around at {n} of the path: {t} long, {t2} away": (
        "machte einen Umweg bei {n} der Bahn: {t} lang, {t2} entfernt"
    ),
    "paused for {n} s at {n2} of the path": "hielt {n} s an, bei {n2} der Bahn",
    "waited for {n} s {t}": "wartete {n} s {t}",
    "before the first move": "vor der ersten Bewegung",
    "after the last move": "nach der letzten Bewegung",
    "another shape than the others: {n} mm off at {n2} of the path": (
        "andere Form als die anderen: {n} mm daneben bei {n2} der Bahn"
    ),
    "drawn more than once: the first time is used": "mehrmals gezeichnet: das erste Mal wird verwendet",
    "drawn in the opposite direction: draw it again from the other end": (
        "in Gegenrichtung gezeichnet: noch einmal vom anderen Ende zeichnen"
    ),
    "the marker was lost at {n} of the path: used around it": (
        "der Marker war bei {n} der Bahn verloren: davor und danach verwendet"
    ),
    "{n} m wide where the others are {n2} m: is it in another unit?": (
        "{n} m breit, wo die anderen {n2} m breit sind: ist die Einheit eine andere?"
    ),
    "excluded by an operator": "von einer Person ausgelassen",
    # recordings that cannot be used
    "positions have shape {x}: two or three columns are needed": (
        "die Positionen haben die Form {x}: zwei oder drei Spalten sind nötig"
    ),
    "times, positions and triggers differ in length: export the recording again": (
        "Zeiten, Positionen und Taster sind verschieden lang: Aufnahme neu exportieren"
    ),
    "orientations need four values (x y z w) a sample: export the recording again": (
        "Orientierungen brauchen vier Werte (x y z w) je Messpunkt: Aufnahme neu exportieren"
    ),
    "{n} samples are no motion: record it again": "{n} Messpunkte sind keine Bewegung: noch einmal aufnehmen",
    "times have to be finite and to rise from sample to sample: export the recording again": (
        "Zeiten müssen endlich sein und steigen: Aufnahme neu exportieren"
    ),
    "the marker was lost nearly throughout: check the cameras and record it again": (
        "der Marker war fast durchweg verloren: Kameras prüfen und noch einmal aufnehmen"
    ),
    "positions beyond a thousand kilometres: check the export's units": (
        "Positionen jenseits von tausend Kilometern: Einheiten des Exports prüfen"
    ),
    "nothing moves further than 1 mm: record it again": "nichts bewegt sich weiter als 1 mm: noch einmal aufnehmen",
    "fewer than four samples are left after striking: include some again": (
        "nach dem Streichen bleiben weniger als vier Messpunkte: einige wieder aufnehmen"
    ),
    "reflections throughout: check the cameras and record it again": (
        "durchweg Reflexionen: Kameras prüfen und noch einmal aufnehmen"
    ),
    "nothing moves further than 1 mm but for reflections and trembling: record it again": (
        "außer Reflexionen und Zittern bewegt sich nichts weiter als 1 mm: noch einmal aufnehmen"
    ),
    "its DemonstrationId was used before": "ihre DemonstrationId gab es schon",
    "it has {n} dimensions, the others have {n2}": "sie hat {n} Dimensionen, die anderen haben {n2}",
    "{n} demonstration is usable, {n2} are needed: record more, or include some again": (
        "{n} Vorführung ist brauchbar, {n2} sind nötig: mehr aufnehmen oder einige wieder einbeziehen"
    ),
    "{n} demonstrations are usable, {n2} are needed: record more, or include some again": (
        "{n} Vorführungen sind brauchbar, {n2} sind nötig: mehr aufnehmen oder einige wieder einbeziehen"
    ),
    "{n} demonstration is usable, {n2} are needed ({t}): record more, or include some again": (
        "{n} Vorführung ist brauchbar, {n2} sind nötig ({t}): mehr aufnehmen oder einige wieder einbeziehen"
    ),
    "{n} demonstrations are usable, {n2} are needed ({t}): record more, or include some again": (
        "{n} Vorführungen sind brauchbar, {n2} sind nötig ({t}): mehr aufnehmen oder einige wieder einbeziehen"
    ),
    "{n} usable demonstrations are needed, {n2} came": "{n} brauchbare Vorführungen sind nötig, gekommen: {n2}",
    "{n} usable demonstrations are needed, {n2} came; {name}: {t}": (
        "{n} brauchbare Vorführungen sind nötig, gekommen: {n2}; {name}: {t}"
    ),
    "{n} demonstrations are needed, the recording has {n2}": "{n} Vorführungen sind nötig, die Aufzeichnung hat {n2}",
    "{name}: {t}": "{name}: {t}",
    # what is to be known of all of them
    "the shape is closed, and {n} of {n2} began elsewhere on it: it begins where most did, {n3} of {n4}": (
        "die Form ist geschlossen, und {n} von {n2} begannen anderswo: sie beginnt, wo die meisten begannen, "
        "{n3} von {n4}"
    ),
    "the same shape was drawn in two places, {n} mm apart, by {a} and by {b}: the path lies between them": (
        "dieselbe Form wurde an zwei Orten gezeichnet, {n} mm auseinander, von {a} und von {b}: "
        "die Bahn liegt dazwischen"
    ),
    "the same shape was drawn in two places, {n} mm apart, by {a} and by {b}: the path is that of the former": (
        "dieselbe Form wurde an zwei Orten gezeichnet, {n} mm auseinander, von {a} und von {b}: "
        "die Bahn ist die der ersteren"
    ),
    "the same shape was drawn in two places, {n} mm apart, by {a} and by {b}: exclude one group, or draw it again in "
    "one place": (
        "dieselbe Form wurde an zwei Orten gezeichnet, {n} mm auseinander, von {a} und von {b}: "
        "eine Gruppe auslassen oder an einem Ort neu zeichnen"
    ),
    "{a} drew {n} mm apart from each other, and of two nobody can tell who is right: let a third person draw it": (
        "{a} zeichneten {n} mm voneinander entfernt, und bei zweien weiß niemand, wer recht hat: "
        "eine dritte Person zeichnen lassen"
    ),
    "{a} are {n} mm apart at {n2} of the path, and of two nobody can tell who is right: let a third person draw it": (
        "{a} sind {n} mm auseinander bei {n2} der Bahn, und bei zweien weiß niemand, wer recht hat: "
        "eine dritte Person zeichnen lassen"
    ),
    "at {n} of the path {a} and {b} go ways {n2} mm apart with nobody between: exclude one group, or draw it again one "
    "way, for the path lies between them": (
        "bei {n} der Bahn gehen {a} und {b} Wege, die {n2} mm auseinanderliegen, und niemand dazwischen: "
        "eine Gruppe auslassen oder auf einem Weg neu zeichnen, denn die Bahn liegt dazwischen"
    ),
    "at {n} of the path the marker of {n2} of {n3} was lost: check it there": (
        "bei {n} der Bahn war der Marker von {n2} von {n3} verloren: die Bahn dort prüfen"
    ),
    "the start of the path is drawn by {n} of {n2} only: check it": (
        "der Anfang der Bahn ist nur von {n} von {n2} gezeichnet: prüfen"
    ),
    "the end of the path is drawn by {n} of {n2} only: check it": (
        "das Ende der Bahn ist nur von {n} von {n2} gezeichnet: prüfen"
    ),
    # recordings that do not belong together
    "some demonstrations have two dimensions and some three: learn them apart": (
        "einige Vorführungen haben zwei Dimensionen, andere drei: getrennt lernen"
    ),
    "two demonstrations have the same id: give each its own": (
        "zwei Vorführungen haben denselben Namen: jeder einen eigenen geben"
    ),
    "the demonstrations do not show the same shape: learn those that belong together, exclude the others": (
        "die Vorführungen zeigen nicht dieselbe Form: lernen, was zusammengehört, das andere auslassen"
    ),
    "some are drawn from one end ({a}) and some from the other ({b}): draw one group again in the other direction, "
    "or exclude it": (
        "einige sind vom einen Ende gezeichnet ({a}), andere vom anderen ({b}): "
        "eine Gruppe in der anderen Richtung neu zeichnen oder auslassen"
    ),
    "different shapes are mixed, and none has a clear majority: {a}, and {b}: learn each as a skill of its own, or "
    "exclude those that do not belong": (
        "verschiedene Formen sind gemischt, keine hat eine klare Mehrheit: {a} und {b}: "
        "jede als eigene Fertigkeit lernen oder Unpassendes auslassen"
    ),
    "the drawing is {n} m wide: positions are in metres, were millimetres sent? Divide them by 1000": (
        "die Zeichnung ist {n} m breit: Positionen sind in Metern, waren es Millimeter? Durch 1000 teilen"
    ),
    "{n} of {n2} demonstrations carry no tool orientation ({a}), so none was learned: record it in all of them, or "
    "exclude those without": (
        "{n} von {n2} Vorführungen haben keine Orientierung des Werkzeugs ({a}), darum wurde keine gelernt: "
        "in allen aufnehmen oder die ohne auslassen"
    ),
    "{a} held the tool up to {n} degrees from how the others did: exclude them, or let them show it again, for the "
    "tool is held as all did on average": (
        "{a} hielten das Werkzeug bis zu {n} Grad anders als die anderen: auslassen oder neu zeigen lassen, "
        "denn es wird im Mittel aller gehalten"
    ),
    "the tool was held in two ways, {n} degrees apart, by {a} and by {b}: exclude one group, or show it again one way, "
    "for the tool is held between them": (
        "das Werkzeug wurde auf zwei Arten gehalten, {n} Grad auseinander, von {a} und von {b}: "
        "eine Gruppe auslassen oder auf eine Art neu zeigen, denn es wird dazwischen gehalten"
    ),
    "most pressed the button where the path does not go on, {n} times, first at {n2} of it: dots are not dispensed, "
    "only beads along the path: press a little before such a place and let go a little after it": (
        "die meisten haben die Taste gedrückt, wo die Bahn nicht weitergeht, {n}-mal, zuerst bei {n2} der Bahn: Punkte "
        "werden nicht dosiert, nur Raupen entlang der Bahn: kurz davor drücken und kurz danach loslassen"
    ),
    "the shape is simplified with {n} components: {n2} mm off the people's mean at {n3} of the path, where it is sure "
    "to {n4} mm": (
        "die Form ist mit {n} Komponenten vereinfacht: {n2} mm neben dem Mittel der Personen bei {n3} der Bahn, "
        "wo es auf {n4} mm sicher ist"
    ),
    # edits and options
    "the learned path has samples 0 to {n}: choose among them": "die gelernte Bahn hat Punkte 0 bis {n}: daraus wählen",
    "there is no demonstration {name} to strike or exclude": (
        "es gibt keine Vorführung {name} zum Streichen oder Auslassen"
    ),
    "demonstration {name} has samples 0 to {n}: choose among them": (
        "Vorführung {name} hat Messpunkte 0 bis {n}: daraus wählen"
    ),
    "{n} components are too many for these demonstrations: ask for fewer": (
        "{n} Komponenten sind für diese Vorführungen zu viele: weniger verlangen"
    ),
    "place is 'free': the paper's preset keeps demonstrations where they were drawn": (
        "place ist 'free': wie veröffentlicht bleiben Vorführungen, wo sie gezeichnet wurden"
    ),
    "{name} is {x}: it has to be between 0 and {y}": "{name} ist {x}: erlaubt ist 0 bis {y}",
    # models
    "the clock is {x}: it has to be 'path' or 'time'": "die Uhr ist {x}: erlaubt ist 'path' oder 'time'",
    "the dimension is {n}: it has to be 2 or 3": "die Dimension ist {n}: erlaubt ist 2 oder 3",
    "means have shape {x}: with the {clock} clock in {n} dimensions they need {n2} columns, or {n3} with orientation": (
        "die Mittelwerte haben die Form {x}: mit der Uhr {clock} in {n} Dimensionen brauchen sie {n2} Spalten, "
        "oder {n3} mit Orientierung"
    ),
    "covariances have shape {x}: to the means belongs {y}": (
        "die Kovarianzen haben die Form {x}: zu den Mittelwerten gehört {y}"
    ),
    "means or covariances hold NaN or infinity: export the skill again": (
        "Mittelwerte oder Kovarianzen enthalten NaN oder unendlich: Fertigkeit neu exportieren"
    ),
    "a component has no extent on the clock: its covariance [0, 0] has to be positive": (
        "eine Komponente hat keine Ausdehnung auf der Uhr: ihre Kovarianz [0, 0] muss positiv sein"
    ),
    "duration and time step have to be positive": "Dauer und Zeitschritt müssen positiv sein",
    # the report's comparisons
    "version {n} has {n2} dimensions, this one {n3}": "Version {n} hat {n2} Dimensionen, diese {n3}",
    "fewer than two demonstrations are usable as they are": "weniger als zwei Vorführungen sind so brauchbar",
}
