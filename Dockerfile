# adaptsim with the simulated lab: docker build -t adaptsim --build-arg VERSION="$(git describe --tags --always)" .
# Then: docker run --rm --user "$(id -u)" -v "$PWD/data:/data" adaptsim run-iteration --task pendulum --world wd --yes
# It runs as the user adaptsim, or as whoever --user names, who needs no home; neither git nor its history is inside.
FROM python:3.11-slim-bookworm

RUN apt-get update \
    && apt-get install -y --no-install-recommends libegl1 libgl1 libusb-1.0-0 libglib2.0-0 libgomp1 \
    && rm -rf /var/lib/apt/lists/* \
    && useradd --uid 10001 --create-home adaptsim \
    && install --directory --owner adaptsim /data

WORKDIR /adaptsim
COPY requirements-run.lock ./
RUN pip install --no-cache-dir --no-deps --requirement requirements-run.lock
COPY pyproject.toml setup.py adaptsim.py README.md LICENSE NOTICE ./
COPY adaptsim_cli adaptsim_cli
COPY calib calib
COPY hw hw
COPY perception perception
COPY sim sim
ARG VERSION=
RUN ADAPTSIM_VERSION="$VERSION" pip install --no-cache-dir --no-deps .

USER adaptsim
ENV ADAPTSIM_HOME=/data MPLCONFIGDIR=/tmp
VOLUME /data
ENTRYPOINT ["adaptsim"]
CMD ["--help"]
