"""Fits the laws of wear, thrust force and power to measurements from a user's own machine.

``python -m turning_env calibrate cuts.csv --out my_tool.toml``; docs/your_own_machine.md is the tutorial.

``reading`` reads the measurements, ``regression`` fits one law, ``material`` all of them, ``scenario_file`` writes the scenario,
``accounts`` says what was found and ``figure`` draws the residuals.
"""
