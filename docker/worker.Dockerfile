# A worker: torch, the deformer and the builtin demonstration prior.
#
#   docker build -f docker/worker.Dockerfile -t meshdeform-worker .
#   docker build -f docker/worker.Dockerfile -t meshdeform-worker:cuda --build-arg TORCH=cuda --build-arg EXTRAS=sd .
FROM python:3.11-slim-bookworm AS build
# cpu or cuda: on Linux the package index has the CUDA build, the CPU build lives on torch's own index.
ARG TORCH=cpu
ARG TORCH_VERSION=2.13.0
# worker, or sd for Stable Diffusion models as well.
ARG EXTRAS=worker
ENV PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1
RUN python -m venv /opt/meshdeform
ENV PATH=/opt/meshdeform/bin:$PATH
RUN case "$TORCH" in \
        cpu) pip install --index-url https://download.pytorch.org/whl/cpu "torch==$TORCH_VERSION+cpu" ;; \
        cuda) pip install "torch==$TORCH_VERSION" ;; \
        *) echo "TORCH is cpu or cuda, not $TORCH" >&2; exit 1 ;; \
    esac
WORKDIR /src
COPY pyproject.toml README.md LICENSE ./
COPY meshdeform meshdeform
COPY service service
COPY worker worker
RUN pip install ".[$EXTRAS]"

FROM python:3.11-slim-bookworm
RUN useradd --uid 10001 --create-home --shell /usr/sbin/nologin meshdeform \
    && install -d -o meshdeform -g meshdeform /data
COPY --from=build /opt/meshdeform /opt/meshdeform
ENV PATH=/opt/meshdeform/bin:$PATH \
    PYTHONUNBUFFERED=1 \
    NUMBA_CACHE_DIR=/tmp/numba \
    MESHDEFORM_DATA_DIR=/data
USER meshdeform
WORKDIR /data
VOLUME /data
# SIGTERM: the worker writes a checkpoint and leaves the job to the next one. Give it the time.
STOPSIGNAL SIGTERM
CMD ["meshdeform", "worker"]
