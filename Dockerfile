# The benchmark without a display and a GPU; docs/platforms.md says how to use it.
FROM python:3.11-slim-bookworm
RUN apt-get update -qq && apt-get install -qq -y --no-install-recommends \
        libegl1 libgl1 libopengl0 libgomp1 libusb-1.0-0 \
    && rm -rf /var/lib/apt/lists/*
COPY . /source
RUN pip install --no-cache-dir -c /source/constraints.txt \
        --extra-index-url https://download.pytorch.org/whl/cpu /source \
    && bench doctor --install \
    && rm -rf /source
# Any user may run it; caches and settings of libraries go here.
ENV HOME=/tmp
WORKDIR /work
ENTRYPOINT ["bench"]
