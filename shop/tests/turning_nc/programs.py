"""Programs that several tests of the reader share."""

from typing import NamedTuple

from turning_nc.moves import Moves, run
from turning_nc.words import divide

ISO = """%
O0001 (TEST)
N10 G21 G99 T0101
N20 G50 S2000
N30 G96 S150 M3
N40 G0 X52. Z2.
N50 G1 Z-20. F0.25
N60 G2 X56. Z-22. R2.
N70 G0 X60. Z2.
N80 M98 P7
N90 M30
O0007
N100 G1 X58. Z1.
M99
%
"""
SIEMENS = """%_N_TEST_MPF
N10 G90 G95 G71 DIAMON T1 D1
N20 G96 S150 LIMS=2000 F0.3 M4
N30 G0 X60 Z2
N40 CYCLE95("KONTUR",2,0.1,0.2,,0.3,,0.15,9)
N50 L5
N60 M30
%_N_KONTUR_SPF
N70 G1 X30 Z0
N80 Z-20
N90 X50 Z-30
N100 M17
%_N_L5_SPF
N110 G1 X62 Z1
N120 RET
"""

# Begins of programs: a bar of 60 mm on a Fanuc, and a tool at X20 on a Fanuc and on a SINUMERIK.
BAR = "G21 G99 T0101\nG97 S800 M3\nG0 X62. Z2.\n"
TURN = "G21 G99 T0101\nG96 S150 M3\nG0 X20. Z2.\nG1 Z0. F0.2\n"
DREH = "G90 G95 G71 DIAMON T1 D1\nG96 S150 M4\nG0 X20 Z2\nG1 Z0 F0.2\n"


def moves(text: str) -> Moves:
    """Return the moves of a program, read by default."""
    return run(divide(text))


class Example(NamedTuple):
    """A program, and Z and radius at the ends of its cuts [mm]."""

    text: str
    ends: list[tuple[float, float]]


AT_20 = "DIAMON G90 G95 G97 S500 F0.2\nG0 X20 Z0\n"

# What real programs hold.
EVERYDAY = {
    "box of a cylinder": Example(
        f"{BAR}G90 X56. Z-40. F0.25\nX52.\nG0 X70.",
        [(-40.0, 28.0), (-40.0, 31.0), (-40.0, 26.0), (-40.0, 31.0)],
    ),
    "box of a cone": Example(
        f"{BAR}G90 X50. Z-40. R-2. F0.25",
        [(-40.0, 25.0), (-40.0, 31.0)],
    ),
    "box of a face": Example(
        f"{BAR}G94 X0. Z1. F0.2\nZ0.",
        [(1.0, 0.0), (2.0, 0.0), (0.0, 0.0), (2.0, 0.0)],
    ),
    "box of a thread": Example(
        f"{BAR}G92 X56. Z-25. F2.\nX55.",
        [(-25.0, 28.0), (-25.0, 27.5)],
    ),
    "thread in one block": Example(
        f"{BAR}G76 X58. Z-30. K1. D0.5 F1.5",
        [(-30.0, 29.5), (-30.0, 29.5 - 0.5 * (2**0.5 - 1)), (-30.0, 29.134), (-30.0, 29.0)],
    ),
    "groove": Example(
        f"{BAR}G0 Z-10.\nG75 R1.\nG75 X56. Z-14. P2000 Q4000 F0.1",
        [(-10.0, 29.0), (-10.0, 28.0), (-14.0, 29.0), (-14.0, 28.0)],
    ),
    "drilling": Example(
        f"{BAR}G0 X0.\nG74 Z-5. Q9000 F0.1\nG83 Z-8. Q2. F0.1",
        [(-5.0, 0.0), (-8.0, 0.0)],
    ),
    "loop of a Fanuc": Example(
        f"{BAR}#1=56.\nWHILE [#1 GE 48.] DO1\nG0 X#1\nG1 Z-40. F0.2\nG0 X62.\nZ2.\n#1=#1-4.\nEND1",
        [(-40.0, 28.0), (-40.0, 26.0), (-40.0, 24.0)],
    ),
    "jumps of a Fanuc": Example(
        f"{BAR}#1=3\nN5 #2=#1*10.\nG0 X[#2+20.]\nG1 Z-#1 F0.2\nIF [#1 LE 1] THEN #3=7\n#1=#1-1\n"
        "IF [#1 GT 0] GOTO 5\nGOTO 9\nG1 X0.\nN9 M30",
        [(-3.0, 25.0), (-2.0, 20.0), (-1.0, 15.0)],
    ),
    "loop and jumps of a SINUMERIK": Example(
        "DIAMON G71 G95 G97 S500 F0.2 M3\nG0 X20 Z0\nR1=2\nANF: G1 Z=-R1\nR1=R1-1\n"
        "IF R1>0 GOTOB ANF\nWHILE R1<2\nG1 X=20-R1\nR1=R1+1\nENDWHILE\nM30",
        [(-2.0, 10.0), (-1.0, 10.0), (-1.0, 9.5)],
    ),
    "blocks with a slash": Example(
        f"{BAR}G1 X56. F0.25\n/2 Z-10.\n/Z-12.",
        [(2.0, 28.0), (-10.0, 28.0), (-12.0, 28.0)],
    ),
    "mark, percent signs and an open comment": Example(
        "\ufeff%\nG21 G91 G28 X0. Z0.\nG90\nG99 G97 S500 M3\nG0 X62. Z2.\n"
        "G1 Z-5. F0.2 (A (NESTED) COMMENT\nM30%",
        [(-5.0, 31.0)],
    ),
    "zero point set by G50": Example(
        "G50 X200. Z100.\nG21 G99 G97 S500 M3\nG1 U-80. F0.2",
        [(100.0, 60.0)],
    ),
    "thread of a SINUMERIK after TRANS": Example(
        "TRANS Z100\nDIAMON G71 G95 G97 S500 M3\nG0 X30 Z5\nG33 Z-25 K1.5 SF=0",
        [(-25.0, 15.0)],
    ),
    "angle, and G2 that stays in force": Example(
        f"{BAR}G1 X60. Z0. F0.2\nX50. ,A135.\nG2 X52. Z-10. R9.\nZ-12.",
        [(0.0, 30.0), (5.0, 25.0), (-10.0, 26.0), (-12.0, 26.0)],
    ),
    "IC": Example(f"{AT_20}G1 X=IC(2) Z=IC(-3)", [(-3.0, 11.0)]),
    "G91 with DIAMON": Example(f"{AT_20}G91 G1 X2 Z-3", [(-3.0, 11.0)]),
    "G91 with DIAM90": Example(f"{AT_20}DIAM90 G91 G1 X2 Z-3", [(-3.0, 12.0)]),
    "DIAMOF": Example(f"{AT_20}DIAMOF G1 X15 Z-3", [(-3.0, 15.0)]),
    "AC": Example(f"{AT_20}G91 G1 X=AC(30) Z-3", [(-3.0, 15.0)]),
}
