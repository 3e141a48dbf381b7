"""What stands on rendered signs: room numbers in the forms of buildings, what else plates hold, and distractors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from random import Random

Draw = Callable[[Random], str]


@dataclass(frozen=True, slots=True)
class NumberForm:
    """One site's form of numbers: a pattern for robot.toml, numbers drawn from it, and what stands `before` each."""

    name: str
    pattern: str
    draw: Draw
    before: str = ""


def _of(template: str) -> Draw:
    """Draws by a template: 9 a digit, 1 none that is 0, 2 a floor, A a capital, b a small letter; the rest as it is."""
    sets = {"9": "0123456789", "1": "123456789", "A": "ABCDEFGHKLMNPRSTUVW", "b": "abcd", "2": "12345"}
    return lambda rng: "".join(rng.choice(sets[c]) if c in sets else c for c in template)


FORMS = (
    NumberForm("three digits", r"[0-9]{3}", _of("199")),
    NumberForm("four digits", r"[0-9]{4}", lambda rng: str(rng.randrange(2100, 10000))),
    NumberForm("two digits", r"[0-9]{2}", _of("19")),
    NumberForm("capital behind", r"[0-9]{3}[A-Z]?", _of("199A")),
    NumberForm("small letter behind", r"[0-9]{2,3}[A-Za-z]?", _of("19b")),
    NumberForm("letter before", r"[A-Z][0-9]{3}", _of("A199")),
    NumberForm("letter apart", r"[A-Z][0-9]{3}", _of("A 199")),
    NumberForm("letter and dash", r"[A-Z]-[0-9]{3}", _of("A-199")),
    NumberForm("floor.room", r"[0-9]\.[0-9]{2}", _of("2.99")),
    NumberForm("floor.three", r"[0-9]\.[0-9]{3}", _of("2.099")),
    NumberForm("floor.room.part", r"[0-9]\.[0-9]{2}\.[0-9]", _of("2.99.1")),
    NumberForm("basement", r"-?[0-9]\.[0-9]{2}", _of("-1.99")),
    NumberForm("ground", r"[UE][0-9]\.[0-9]{2}", _of("U1.09")),
    NumberForm("building-room", r"[0-9]{1,2}-[0-9]{3}", _of("19-199")),
    NumberForm("building-room letter", r"[0-9]{1,2}-[0-9]{3}[A-Z]?", _of("2-199A")),
    NumberForm("block-room", r"[A-Z][0-9]{2}-[0-9]{3}", _of("A19-199")),
    NumberForm("wing-floor-room", r"[A-Z]-[0-9]-[0-9]{2}", _of("A-2-19")),
    NumberForm("slash", r"[0-9]/[0-9]{2}", _of("2/19")),
    NumberForm("bar", r"S[0-9]\|[0-9]{2}", _of("S1|09")),
    NumberForm("wing.floor.room", r"[A-Z]\.[0-9]\.[0-9]{3}", _of("B.2.019")),
    NumberForm("two letters", r"[A-Z]{2}[0-9]{3}", _of("AA199")),
    NumberForm("two letters apart", r"[A-Z]{2}[0-9]{2}", _of("AA 19")),
    NumberForm("leading zero", r"0[0-9]{2}", _of("019")),
    NumberForm("leading zeros and letter", r"00[0-9][a-z]?", _of("001b")),
    NumberForm("apart", r"[0-9]{2} [0-9]{3}", _of("19 199")),
    NumberForm("letter.three", r"[A-Z]\.[0-9]{3}", _of("A.199")),
    NumberForm("word Raum", "[0-9]{3}", _of("199"), before="Raum "),
    NumberForm("word Room", "[0-9]{3}", _of("199"), before="Room "),
    NumberForm("No.", "[0-9]{3}", _of("199"), before="No. "),
    NumberForm("number sign", "[0-9]{3}", _of("199"), before="#"),
    NumberForm("five digits", r"[0-9]{5}", _of("19999")),
    NumberForm("building letter-room", r"[0-9]{1,2}[A-Z]-[0-9]{3}", _of("1A-199")),
)

NAMES = (
    "Dr. A. Keller", "M. Osei", "Prof. Lindqvist", "J. Park", "Garcia", "Ms. Tanaka", "E. Novak", "S. Rahman",
    "Dr. Chen", "P. Laurent", "K. Yilmaz", "Rossi", "B. O'Neill", "F. Almeida",
)  # fmt: skip
TYPES = ("Office", "Meeting Room", "Laboratory", "Seminar Room", "Storage", "Kitchen", "Library", "Copy Room")
RESTROOMS = (
    "MEN", "WOMEN", "WC", "RESTROOM", "STAIR", "STAIRS", "HERREN", "DAMEN", "HOMMES", "FEMMES", "ASEOS",
    "CABALLEROS", "BAGNO", "TREPPE", "ELEVATOR",
)  # fmt: skip

# Signs that hold no number of a room, line by line; {…} is drawn
_DISTRACTORS = (
    ("Rooms", "{a}-{b} →"),
    ("← {a}-{b}",),
    ("{a} – {b}", "↑"),
    ("Offices", "{a} to {b}"),
    ("{a}", "{b}", "{c}", "{d}"),
    ("Opening hours", "Mon-Fri 8:00-16:30", "Sat 9:00-12:00"),
    ("Open", "9-17"),
    ("8:30 - 12:00",),
    ("Coffee 1.80 €", "Tea 1.50 €", "Cake 2.40 €"),
    ("$ 3.50",),
    ("SALE", "50 %"),
    ("EXIT",),
    ("EMERGENCY EXIT", "Push bar to open"),
    ("FIRE", "In case of fire call 112"),
    ("Fire extinguisher", "6 kg ABC"),
    ("Emergency 112",),
    ("DANGER", "230 V"),
    ("Caution", "400V"),
    ("{name}",),
    ("{name}", "{name2}"),
    ("Course 4711", "begins 3 May"),
    ("Open day", "2019"),
    ("Concert", "hall, doors", "20:15"),
    ("Exam week", "12-16 May", "2026"),
    ("Career fair", "1500 jobs"),
    ("Call 905 525", "9140"),
    ("House keeper", "Tel. 0171 555 238"),
    ("Inv.-Nr. 104711",),
    ("Model HX-450", "Serial 2093841"),
    ("© 2024", "All rights reserved"),
    ("Please close", "the door"),
    ("No smoking",),
    ("Max. 8 persons", "630 kg"),
    ("Platform 9", "Trains to 12"),
    ("Lost keys:", "call 5500"),
    ("WiFi: guest", "Password 84h2k9"),
    ("-1", "0", "1", "2", "3"),
    ("Bus 204 → Airport", "every 12 min"),
    ("Room change!", "Math 101 now in 305", "Physics 210 in 118"),
    ("ISO 9001", "certified"),
    ("50 YEARS", "1974 - 2024"),
)


def distractor(rng: Random) -> tuple[str, ...]:
    """The lines of a sign that must not be taken for a plate."""
    a = rng.randrange(101, 380)
    values = {
        "a": a, "b": a + rng.randrange(3, 40), "c": a + 41, "d": a + 43,
        "name": rng.choice(NAMES), "name2": rng.choice(NAMES),
    }  # fmt: skip
    return tuple(line.format(**values) for line in rng.choice(_DISTRACTORS))
