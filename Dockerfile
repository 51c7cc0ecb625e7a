# The robo image: runtime, shipped nodes, tools.
#   docker build --network=host -t robo .
#   docker run --rm -p 127.0.0.1:7447:7447 robo up --listen tcp/0.0.0.0:7447
ARG PYTHON_VERSION=3.12

FROM python:${PYTHON_VERSION}-slim AS build
# An init that hands signals on and reaps what nodes leave behind; only the program goes into the image.
RUN apt-get update -qq && apt-get install -y -qq --no-install-recommends tini
WORKDIR /src
COPY pyproject.toml README.md LICENSE ./
COPY messages messages
COPY services services
COPY launch launch
COPY config config
COPY logs logs
COPY robo robo
RUN pip wheel --quiet --no-cache-dir --no-deps --wheel-dir /wheels .
# For example --build-arg EXTRAS=dashboard,ros2,serial; what the page and the bridge to ROS 2 need is but 3 MB.
ARG EXTRAS="dashboard,ros2"
RUN python -m venv --without-pip /opt/robo \
 && pip --python /opt/robo/bin/python install --quiet --no-cache-dir "$(ls /wheels/*.whl)${EXTRAS:+[$EXTRAS]}"
# One name for where packages stand, whatever Python's version: exported Compose files refer to it.
RUN ln -s "$(cd /opt/robo && echo lib/python*/site-packages)" /opt/robo/site-packages

FROM python:${PYTHON_VERSION}-slim
ARG VERSION=0.1.0
LABEL org.opencontainers.image.title="robo" \
      org.opencontainers.image.description="Robots as microservices over Zenoh" \
      org.opencontainers.image.version="${VERSION}" \
      org.opencontainers.image.licenses="Apache-2.0"
# What nodes keep over restarts of their container is in a volume there.
RUN useradd --uid 1000 --create-home robo && install -d -o robo /var/lib/robo
COPY --from=build /usr/bin/tini /usr/bin/tini
COPY --from=build /opt/robo /opt/robo
# Containers share no /dev/shm: large messages between them take sockets anyway.
# `pip install` in images that are built on this one: Python's own pip, into robo's environment.
ENV PATH=/opt/robo/bin:$PATH \
    PIP_PYTHON=/opt/robo/bin/python \
    PYTHONUNBUFFERED=1 \
    PYTHONDONTWRITEBYTECODE=1 \
    ROBO_SHM=off \
    XDG_STATE_HOME=/tmp
USER robo
WORKDIR /home/robo
# As Ctrl-C ends it: what else runs in a container than nodes may listen to this one alone.
STOPSIGNAL SIGINT
ENTRYPOINT ["tini", "-g", "--", "robo"]
CMD ["up"]
HEALTHCHECK --interval=5s --timeout=3s --start-period=10s --retries=3 CMD ["robo", "health"]
