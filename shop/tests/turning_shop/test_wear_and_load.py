"""The program that measures how forces grow with wear finds the growth that made-up tables have."""

import runpy
from pathlib import Path

import numpy as np
import pytest

PROGRAM = Path(__file__).parents[2] / "examples" / "wear_and_load.py"
WEAR = np.linspace(0.02, 0.4, 39)


@pytest.fixture
def vicomtech(tmp_path: Path) -> Path:
    """Return a table of two edges: main force affine in wear, thrust force a power of wear."""
    lines = ["tool,Vb,F_c_MEAN,F_f_MEAN,F_p_MEAN"]
    for tool, scale in (("1", 1.0), ("2", 1.5)):
        for wear in WEAR:
            main_force = 500.0 * scale * (1.0 + 2.0 * wear)
            feed_force = 900.0 * scale * wear**0.5
            lines.append(f"{tool},{1000.0 * wear},{main_force},{feed_force},0")
    path = tmp_path / "vicomtech.csv"
    path.write_text("\n".join(lines), "utf-8")
    return path


@pytest.fixture
def h13(tmp_path: Path) -> Path:
    """Return a table of one setting, with thrust forces of 50, 100 and 300 N.

    The edge is fresh, worn to 0.1 mm, and worn to 0.3 mm.
    """
    lines = ["Run_ID,TCond,ap,vc,f,Fx,Fy,Fz"]
    lines += ["run0,0,0.25,350,0.1,80,50.0,0"] * 6
    lines += ["run1,0.1,0.25,350,0.1,80,100.0,0"] * 6
    lines += ["run2,0.3,0.25,350,0.1,80,300.0,0"] * 6
    path = tmp_path / "Exp2.csv"
    path.write_text("\n".join(lines), "utf-8")
    return path


def test_it_finds_exponents_growth_and_forms(
    vicomtech: Path, h13: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runpy.run_path(str(PROGRAM))["main"](vicomtech, h13)
    printed = capsys.readouterr().out
    assert "Vicomtech: 78 readings" in printed
    assert "H13: 3 readings" in printed
    assert "thrust force: exponent 0.50; from 0.1 to 0.3 mm x1.73 (mean of 2)" in printed
    assert "thrust force: exponent 1.00; from 0.1 to 0.3 mm x3.00 (mean of 1)" in printed
    assert "main force: affine law better on 2 of 2 edges" in printed
    assert "thrust force: affine law better on 0 of 2 edges" in printed
    assert "b 2.0 to 2.0 per mm" in printed
    assert "thrust force: a fresh edge has 50 % of the force at 0.1 mm" in printed
