# adaptsim with the simulated lab: docker build -t adaptsim .
# Then: docker run --rm -v "$PWD/data:/data" adaptsim run-iteration --task pendulum --world wd --yes
FROM python:3.11-slim-bookworm

RUN apt-get update \
    && apt-get install -y --no-install-recommends git libegl1 libgl1 libusb-1.0-0 libglib2.0-0 libgomp1 \
    && rm -rf /var/lib/apt/lists/*

WORKDIR /adaptsim
COPY requirements-run.lock ./
ARG TORCH_INDEX=https://download.pytorch.org/whl/cpu
RUN pip install --no-cache-dir --index-url "$TORCH_INDEX" torch==2.13.0 \
    && pip install --no-cache-dir --requirement requirements-run.lock
COPY . .
RUN pip install --no-cache-dir --no-deps .

ENV ADAPTSIM_HOME=/data
VOLUME /data
ENTRYPOINT ["adaptsim"]
CMD ["--help"]
