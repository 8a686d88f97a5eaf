# A worker: torch, the deformer and the builtin demonstration prior.
#
#   docker build -f docker/worker.Dockerfile -t meshdeform-worker .
#   docker build -f docker/worker.Dockerfile -t meshdeform-worker:cuda --build-arg TORCH=cuda --build-arg EXTRAS=worker,sd .
#
# Pinned by exact version. For a digest as well, ask your registry: docker buildx imagetools inspect IMAGE
FROM python:3.11.14-slim-bookworm AS build
# cpu or cuda: on Linux the package index has the CUDA build, the CPU build lives on torch's own index.
ARG TORCH=cpu
ARG TORCH_VERSION=2.13.0
# worker, or sd for Stable Diffusion models as well.
ARG EXTRAS=worker
# The constraints hold for the build backend, too.
ENV PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_CONSTRAINT=/src/docker/constraints.txt
RUN python -m venv /opt/meshdeform
ENV PATH=/opt/meshdeform/bin:$PATH
WORKDIR /src
COPY docker/constraints.txt docker/constraints.txt
# torch's own index has other versions of what torch needs; what it brings is put right by the next installation.
RUN case "$TORCH" in \
        cpu) PIP_CONSTRAINT='' pip install --index-url https://download.pytorch.org/whl/cpu "torch==$TORCH_VERSION+cpu" ;; \
        cuda) pip install "torch==$TORCH_VERSION" ;; \
        *) echo "TORCH is cpu or cuda, not $TORCH" >&2; exit 1 ;; \
    esac
COPY pyproject.toml README.md LICENSE NOTICE ./
COPY meshdeform meshdeform
COPY service service
COPY worker worker
RUN pip install --constraint docker/constraints.txt ".[$EXTRAS,otel]"
# Compile what jobs need, for the processor of this machine; a worker on another kind compiles it again when it starts.
# The cache knows sources by their times, of which a pushed image keeps the whole seconds.
RUN python -c "import os, pathlib; [os.utime(p, (int(p.stat().st_mtime),) * 2) for p in pathlib.Path('/opt/meshdeform').rglob('*.py')]" \
    && NUMBA_CACHE_DIR=/opt/kernels python -m meshdeform.runs.rehearsal

FROM python:3.11.14-slim-bookworm
RUN useradd --uid 10001 --no-create-home --shell /usr/sbin/nologin meshdeform \
    && install -d -o meshdeform -g meshdeform /data /data/tmp
COPY --from=build /opt/meshdeform /opt/meshdeform
COPY --from=build /opt/kernels /opt/kernels
# Whatever libraries want to keep, they keep under /tmp or /data: the rest is read-only where the compose file says so.
ENV PATH=/opt/meshdeform/bin:$PATH \
    PYTHONUNBUFFERED=1 \
    PYTHONDONTWRITEBYTECODE=1 \
    HOME=/tmp \
    NUMBA_CACHE_DIR=/tmp/numba \
    TMPDIR=/data/tmp \
    MESHDEFORM_DATA_DIR=/data \
    MESHDEFORM_CACHE_DIR=/data/cache
USER 10001:10001
WORKDIR /data
VOLUME /data
# A worker has no port; its supervisor gives a sign of life every ten seconds.
HEALTHCHECK --interval=15s --timeout=5s --start-period=30s --retries=3 CMD ["python", "-m", "worker.health"]
# SIGTERM: the worker writes a checkpoint and leaves the job to the next one. Give it the time.
STOPSIGNAL SIGTERM
# numba only uses a cache that it can write to.
ENTRYPOINT ["/bin/sh", "-c", "cp -R /opt/kernels/. \"$NUMBA_CACHE_DIR\" || true; exec \"$@\"", "--"]
CMD ["meshdeform", "worker"]
