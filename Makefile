# The commands that people type. Every one sets up what it needs.

PYTHON ?= $(shell command -v python3.11 || command -v python3)
SCENARIO ?= rough_turning
INTERVALS ?=
DRAWS ?= 256
BOARD_DRAWS ?= 64
RUNS ?= runs
RESULTS ?= results
ENVS ?= RoughTurning-v0 RoughTurning-Paper-v0 RoughTurning-Override-v0 RoughTurning-Surface-v0 RoughTurning-Shift-v0 RoughTurning-Batch-v0
TRAIN = .venv/bin/python -m train.ppo --scenario $(SCENARIO) --runs $(RUNS) $(if $(INTERVALS),--intervals $(INTERVALS))
RUN = .venv/bin/python -m leaderboard run --scenario $(SCENARIO) --draws $(DRAWS) --results $(RESULTS)
AGENT = $(RUNS)/RoughTurning-v0/$(SCENARIO)/ppo-seed

.PHONY: leaderboard seeds boards test format clean

# Train an agent, play it and every baseline on the held-out draws, rank them.
leaderboard: .venv/ready
	$(TRAIN) --seed 0
	$(RUN) --agents $(AGENT)0

# The same with five training seeds, two trainings at a time.
seeds: .venv/ready
	printf '%s\n' 0 1 2 3 4 | xargs -P 2 -I{} $(TRAIN) --seed {}
	$(RUN) --agents $(foreach seed,0 1 2 3 4,$(AGENT)$(seed))

# Every controller of the literature on every task that it can play.
boards: .venv/ready
	set -e; for env in $(ENVS); do .venv/bin/python -m leaderboard run --env $$env --draws $(BOARD_DRAWS) --results $(RESULTS); done

# Lint, types and tests.
test: .venv/ready
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/mypy
	.venv/bin/pytest -n 2

format: .venv/ready
	.venv/bin/ruff check --fix .
	.venv/bin/ruff format .

clean:
	rm -rf .venv $(RUNS) $(RESULTS)

.venv/ready: pyproject.toml constraints.txt
	test -x .venv/bin/python || $(PYTHON) -m venv .venv
	.venv/bin/python -m pip install --disable-pip-version-check -c constraints.txt hatchling editables
	.venv/bin/python -m pip install --disable-pip-version-check -c constraints.txt --no-build-isolation -e '.[benchmark,test]'
	touch $@
