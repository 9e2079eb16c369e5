# Images whose machine code is compiled, so that they play at once.
#
#   docker build --target use --tag rough-turning .
#   docker run --rm rough-turning python -m turning_env whatif rough_turning --cutting-speed 150 --feed 0.3 --wear 0.2
#
# The target `evaluate` scores strangers' agents: docs/organise.md.
ARG PYTHON=docker.io/library/python:3.13-slim

FROM ${PYTHON} AS use
# Machine code for every processor of the architecture. For the speed of your own, run with --env NUMBA_CPU_NAME= and wait for half a minute.
ENV NUMBA_CPU_NAME=generic NUMBA_CACHE_DIR=/opt/machine_code
COPY . /src
RUN pip install --no-cache-dir "/src[render,workshop,programs]" && cd / && python -m turning_env warm-up
CMD ["python", "-m", "turning_env", "--help"]

FROM use AS evaluate
WORKDIR /src
RUN pip install --no-cache-dir onnx onnxruntime jinja2 joblib tqdm && python -m turning_env warm-up
ENTRYPOINT ["python", "-m", "leaderboard", "run", "--results", "/results"]
