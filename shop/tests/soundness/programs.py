"""Part programs to try: grammatical ones with odd numbers, and valid ones that are damaged."""

from collections.abc import Sequence
from random import Random

from shop.examples.adapt_programs import COLLECTION, path_of
from shop.tests.turning_nc.programs import EVERYDAY, ISO, SIEMENS

NUMBERS = (
    "0",
    "-0",
    "0.",
    "1",
    "1.",
    "-1.",
    ".5",
    "-.25",
    "2.",
    "5",
    "10.",
    "-20.",
    "35.",
    "60.",
    "62.",
    "-150.",
    "1000",
    "99999",
    "0.0001",
    "-0.0000001",
    "123456789.",
    "1e300",
    "-1e5",
    "9" * 400,
    "." + "0" * 400 + "1",
    "0x1F",
    "1.2.3",
    "--5",
    "+",
    "inf",
)
EXPRESSIONS = (
    "#1",
    "#1-#1",
    "1/0",
    "#1/#2",
    "5 MOD 0",
    "ABS[]",
    "SQRT[-1]",
    "LN[0]",
    "LN[-1]",
    "EXP[1000]",
    "TAN[90]",
    "ACOS[2]",
    "SIN[#1]",
    "1,2",
    "ROUND[0.5]",
    "FIX[1/0]",
    "#999999",
    "#0",
    "1 GT 2",
    "1 EQ 1 AND 2",
    "#1*#1",
    "9" * 400,
    "9*" * 40 + "9",
    "[" * 60 + "1" + "]" * 60,
    "-" * 50 + "1",
    "FUP[" + "9" * 320 + "]",
    "0*9" + "9" * 310,
)
PLAIN = ("10.", "-5.", "20.", "#1", "2*3", "40.-#1", "[#1+1.]*2.")
LENGTHS = ("X", "Z", "U", "W", "I", "K", "R", "F", ",C", ",R", "A", ",A")
INTEGERS = ("M", "S", "T", "P", "Q", "L", "D", "N", "G", "O")
MOTIONS = (
    "G0",
    "G1",
    "G1",
    "G1",
    "G2",
    "G3",
    "G4",
    "G28",
    "G32",
    "G50",
    "G53",
    "G90",
    "G92",
    "G94",
    "G98",
    "G99",
    "G96",
    "G97",
)
CYCLES = (
    "G71 U2. R1.\nG71 P1 Q2 U0.4 W0.1 F0.25\nN1 G0 X30.\nG1 Z-20.\nN2 X60.",
    "G71 P1 Q2 U0.4 W0.1 D2000 F0.25\nN1 G0 X30.\nG1 Z-20.\nN2 X60.\nG70 P1 Q2",
    "G72 W2. R1.\nG72 P1 Q2 U0.4 W0.1 F0.25\nN1 G0 Z-20.\nG1 X30.\nN2 Z2.\nG70 P1 Q2",
    "G73 U5. W1. R3\nG73 P1 Q2 U0.4 W0.1 F0.25\nN1 G0 X30.\nG1 Z-20.\nN2 X60.",
    "G74 R1.\nG74 X20. Z-20. P2000 Q5000 F0.1",
    "G75 R1.\nG75 X20. Z-20. P2000 Q5000 F0.1",
    "G76 P020060 Q50 R0.02\nG76 X28. Z-30. P1000 Q400 F2.",
    "G83 Z-20. Q5. F0.1",
    "G90 X50. Z-20. R1. F0.2\nX40.",
    "#1=60.\nWHILE [#1 GT 20.] DO1\nG1 X#1 F0.2\nZ-10.\nZ1.\n#1=#1-5.\nEND1",
    "#2=3\nN7 G1 U-1. F0.1\n#2=#2-1\nIF [#2 GT 0] GOTO 7",
    "M98 P70002\nM98 P2 L5",
    "IF [#1 EQ 2] THEN #3=4\nG1 X#3",
    "N8 GOTO 8",
    "WHILE [1 EQ 1] DO2\nEND2",
)
SINUMERIK_CYCLES = (
    'CYCLE95("C",2,0.1,0.2,,0.3,,0.15,9,,,1)',
    'CYCLE95("A:E",2,0.1,0.2,,0.3,,0.15,1)\nA: G1 X30 Z0\nZ-20\nX50\nE: Z-40',
    "CYCLE97(1.5,,0,-32,30,30,6,2,1,0.1,30,0,2,1,1,1)",
    "R1=5\nWHILE R1>0\nG1 X=R1*10 Z=IC(-1) F0.2\nR1=R1-1\nENDWHILE",
    "L5 P3",
    "A1: R2=R2+1\nG1 X=R2\nIF R2<4 GOTOB A1",
    "G1 X20 RND=2\nZ-10 CHF=1\nX30",
    'TRANS Z10\nMSG("A")\nG96 S150 LIMS=2000',
    "ID=1 DO $AC_OVR=50",
)
STOCKS = ("bar:60x100", "tube:60x20x100+1", "bar:0.5x1", "bar:10000x100000", None)
TOOLS = (
    "outside",
    "inside",
    "copying-left",
    "neutral",
    "groove:3",
    "groove:2-inside",
    "face-groove:4",
    "face-groove:3-outer",
    "drill:8",
    None,
)
NOISE = (*"();[]#=/%-.09,\0\ufeff\r\n\t\u2028é", '"', "N1", "M99")

FANUC_HEAD = "G21 G99 T0101\nG50 S3000\nG96 S150 M3\n#1=5.\nG0 X62. Z2.\nF0.2\n"
FANUC_TAIL = "M30\nO2\nG1 U-1. Z-5.\nG0 Z2.\nM99\n"
SINUMERIK_HEAD = (
    "%_N_T_MPF\nG90 G95 G71 DIAMON T1 D1\nG96 S150 LIMS=2500 F0.2 M4\nR1=5 R2=1\nG0 X62 Z2\n"
)
SINUMERIK_TAIL = (
    "M30\n%_N_C_SPF\nG1 X30 Z0\nZ-20\nX50 Z-30\nM17\n%_N_L5_SPF\nG1 X40 Z-5\nG0 X62\nRET\n"
)


def any_program(random: Random) -> str:
    """Return a grammatical program, or a damaged one."""
    if random.random() < 0.6:
        return program(random)
    return damaged(valid(random), random)


def program(random: Random) -> str:
    """Return a program of some lines, in either dialect, sometimes damaged."""
    if random.random() < 0.35:
        text = SINUMERIK_HEAD + _lines(SINUMERIK_CYCLES, random) + SINUMERIK_TAIL
    else:
        text = FANUC_HEAD + _lines(CYCLES, random) + FANUC_TAIL
    return damaged(text, random) if random.random() < 0.3 else text


def valid(random: Random) -> str:
    """Return a program of the collection, or of the tests."""
    if random.random() < 0.3:
        return path_of(random.choice(list(COLLECTION))).read_text("latin-1")
    everyday = [example.text for example in EVERYDAY.values()]
    return random.choice([*everyday, ISO, SIEMENS])


def damaged(text: str, random: Random) -> str:
    """Return a text with some places changed, repeated or cut out."""
    for _ in range(random.randint(1, 4)):
        place = random.randrange(len(text) + 1)
        before = text[:place]
        after = text[place:]
        kind = random.choice(("noise", "gap", "repetition", "number", "expression"))
        if kind == "noise":
            text = before + random.choice(NOISE) + after
        elif kind == "gap":
            text = before + after[random.choice((1, 1, 3, 30)) :]
        elif kind == "repetition":
            start = random.randrange(len(text) + 1)
            length = random.choice((2, 10, 60))
            text = before + text[start : start + length] + after
        elif kind == "number":
            text = before + random.choice(NUMBERS) + after
        else:
            text = before + f"[{random.choice(EXPRESSIONS)}]" + after
    return text


def _lines(cycles: Sequence[str], random: Random) -> str:
    """Return some blocks and cycles."""
    lines = []
    for _ in range(random.randint(1, 8)):
        if random.random() < 0.35:
            lines.append(_with_odd_number(random.choice(cycles), random))
        else:
            lines.append(_block(random))
    return "\n".join(lines) + "\n"


def _block(random: Random) -> str:
    """Return a block of up to five words."""
    words = []
    if random.random() < 0.8:
        words.append(random.choice(MOTIONS))
    for _ in range(random.randint(0, 4)):
        addresses = LENGTHS if random.random() < 0.8 else INTEGERS
        words.append(random.choice(addresses) + _value(random))
    return " ".join(words)


def _value(random: Random) -> str:
    """Return the value of a word: mostly a number that a machine can reach."""
    kind = random.random()
    if kind < 0.6:
        if random.random() < 0.7:
            return f"{random.uniform(-70.0, 70.0):.3f}"
        return str(random.randint(0, 300))
    if kind < 0.75:
        return random.choice(NUMBERS)
    expressions = EXPRESSIONS if random.random() < 0.6 else PLAIN
    return f"[{random.choice(expressions)}]"


def _with_odd_number(text: str, random: Random) -> str:
    """Return a text with one of its numbers replaced, or as it is."""
    places = [place for place, letter in enumerate(text) if letter.isdigit()]
    if random.random() < 0.4 or not places:
        return text
    first = random.choice(places)
    last = first
    while last < len(text) and (text[last].isdigit() or text[last] == "."):
        last += 1
    is_odd = random.random() < 0.7
    number = random.choice(NUMBERS) if is_odd else f"{random.uniform(-99, 99):.2f}"
    return text[:first] + number + text[last:]
