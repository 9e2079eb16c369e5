# The commands that people type. Every one sets up what it needs.

PYTHON ?= $(shell command -v python3.11 || command -v python3)
SCENARIO ?= rough_turning
STEPS ?=
DRAWS ?= 256
BOARD_DRAWS ?= 64
LONG_DRAWS ?= 32
OTHER_PYTHON ?=
RUNS ?= runs
RESULTS ?= results
SHIPPED ?= agents
ROWS ?= leaderboard/results
JOBS ?= 2
ENVS ?= RoughTurning-v0 RoughTurning-Paper-v0 RoughTurning-Override-v0 RoughTurning-Surface-v0 RoughTurning-Shift-v0 RoughTurning-Batch-v0
TRAIN = .venv/bin/python -m train.ppo --scenario $(SCENARIO) --runs $(RUNS) $(if $(STEPS),--steps $(STEPS))
RUN = .venv/bin/python -m leaderboard run --scenario $(SCENARIO) --draws $(DRAWS) --results $(RESULTS)
AGENT = $(RUNS)/RoughTurning-v0/$(SCENARIO)/ppo-seed

# What is installed beside the environment's own needs, by extra. pip takes hashes only of what it is told by name, not of a folder.
EXTRAS = benchmark distributed render ecosystem docs test
PIP = .venv/bin/python -m pip --disable-pip-version-check
NEEDS = import sys, tomllib; project = tomllib.load(open("pyproject.toml", "rb"))["project"]; \
	print(*project["dependencies"], *(need for extra in sys.argv[1:] for need in project["optional-dependencies"][extra]), sep="\n")
# A package's lines of constraints.txt: its version and the hashes of all of that version's files.
pinned = sed -n '/^$(1)==/,/[^\]$$/p' constraints.txt

# Agents that come with the project: environment's id and algorithm.
AGENTS ?= $(addprefix RoughTurning-v0/,analytic_gradient ppo recurrent_ppo lagrangian_ppo sac tqc) \
	$(addprefix RoughTurning-Override-v0/,analytic_gradient ppo) RoughTurning-Surface-v0/ppo \
	RoughTurning-Shift-v0/analytic_gradient RoughTurning-Batch-v0/ppo
SEEDS ?= 0 1 2 3 4

.PHONY: setup leaderboard agents rows verify test soak wheel audit constraints format clean

# What every other command needs.
setup: .venv/ready

# Train an agent, play it, rank it with every rule and agent that comes with the project: their results need not be played again.
leaderboard: .venv/ready
	$(TRAIN) --seed 0
	mkdir -p $(RESULTS)
	cp -R leaderboard/results/. $(RESULTS)
	$(RUN) --agents $(AGENT)0

# Train all agents that come with the project anew, two at a time, and export them.
agents: .venv/ready
	printf '%s\n' $(foreach agent,$(AGENTS),$(foreach seed,$(SEEDS),$(agent)/$(seed))) | xargs -P 2 -I{} sh -c '\
		set -e -- $$(echo {} | tr / " "); \
		run=$$(.venv/bin/python -m train.$$2 --env $$1 --seed $$3 --runs $(RUNS) $(if $(STEPS),--steps $(STEPS))); \
		folder=$$(dirname $$run); \
		.venv/bin/python -m train.export $$folder --out $(SHIPPED)/$$1/$$(basename $$(dirname $$folder))'

# Play all that comes with the project: the rows of the leaderboard.
rows: .venv/ready
	set -e; for env in $(ENVS); do \
		case $$env in \
			RoughTurning-v0) draws="--draws $(DRAWS) --splits --split-draws $(LONG_DRAWS)";; \
			RoughTurning-Batch-v0) draws="--draws $(DRAWS)";; \
			RoughTurning-Shift-v0) draws="--draws $(LONG_DRAWS)";; \
			*) draws="--draws $(BOARD_DRAWS)";; \
		esac; \
		.venv/bin/python -m leaderboard run --env $$env --results $(ROWS) --jobs $(JOBS) $$draws \
			--agents $$(ls $(SHIPPED)/$$env/*/*.onnx 2> /dev/null); \
	done
	.venv/bin/python -m leaderboard cards --rows $(ROWS) --agents $(SHIPPED)

# Play the rows again and fail if a number does not come back.
verify: .venv/ready
	.venv/bin/python -m leaderboard verify --jobs $(JOBS) $(VERIFY)

# Lint, types and tests.
test: .venv/ready
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/python -m tests.compile & compiling=$$!; .venv/bin/mypy && wait $$compiling
	.venv/bin/pytest -n 2 --dist worksteal

# What is promised, on far more inputs than in the tests, by fuzzing for ten minutes a reader, by twenty kills of each program and on
# a hundred million intervals (docs/soundness.md): some hours.
soak: .venv/ready
	HYPOTHESIS_PROFILE=soak .venv/bin/pytest tests/soundness -n 2 --hypothesis-show-statistics
	$(PIP) install --only-binary :all: -c constraints.txt --group fuzz || echo "There is no atheris for this machine: inputs are drawn at random."
	.venv/bin/python -m benchmarks.fuzz
	.venv/bin/python -m benchmarks.soak

# The wheel in an empty environment: what it holds, that it runs, and gives the same bytes; likewise with other versions of Python.
wheel: .venv/ready
	.venv/bin/python -m benchmarks.wheel --python .venv/bin/python $(OTHER_PYTHON)

# Licences, changed files and known vulnerabilities of what is installed.
audit: .venv/ready
	$(PIP) install --only-binary :all: -c constraints.txt --group audit
	.venv/bin/python -m benchmarks.audit

# Write constraints.txt anew for what pyproject.toml asks, on all platforms; versions stay, but with UPGRADE=--upgrade. Hashes of other
# builds stay with their version, as that of torch without CUDA, which the index does not serve: `pip hash` gives that of a new one.
constraints: .venv/ready
	$(PIP) install --only-binary :all: -c constraints.txt --group pin
	.venv/bin/uv pip compile --quiet --universal --python-version 3.11.5 --generate-hashes --no-annotate \
		--custom-compile-command "make constraints" $(UPGRADE) -o constraints.txt pyproject.toml \
		$(addprefix --extra ,$(EXTRAS)) --group setup --group audit --group pin --group fuzz

format: .venv/ready
	.venv/bin/ruff check --fix .
	.venv/bin/ruff format .

clean:
	rm -rf .venv $(RUNS) $(RESULTS)

# pip first: older ones do not look for hashes in constraints. Then torch from a folder of wheels, if pip's settings name one: such a
# build without CUDA is a tenth of the download. Every file is compared with its hashes; only the clone itself has none.
.venv/ready: pyproject.toml constraints.txt
	test -x .venv/bin/python || $(PYTHON) -m venv .venv
	$(call pinned,pip) | $(PIP) install -r /dev/stdin
	$(call pinned,torch) | $(PIP) install --no-index --no-deps -r /dev/stdin || echo "No folder of wheels has torch: it comes from the index."
	.venv/bin/python -c '$(NEEDS)' $(EXTRAS) > .venv/needs.txt
	$(PIP) install --only-binary :all: -c constraints.txt --group setup -r .venv/needs.txt
	$(PIP) install --no-deps --no-build-isolation -e .
	touch $@
