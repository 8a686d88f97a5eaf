# The API. No torch inside: it takes requests, checks files, and tells the workers.
#
#   docker build -f docker/service.Dockerfile -t meshdeform-service .
#
# Pinned by exact version. For a digest as well, ask your registry: docker buildx imagetools inspect IMAGE
FROM python:3.11.14-slim-bookworm AS build
# The constraints hold for the build backend, too.
ENV PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_CONSTRAINT=/src/docker/constraints.txt
RUN python -m venv /opt/meshdeform
ENV PATH=/opt/meshdeform/bin:$PATH
WORKDIR /src
COPY docker/constraints.txt docker/constraints.txt
COPY pyproject.toml README.md LICENSE NOTICE ./
COPY meshdeform meshdeform
COPY service service
COPY worker worker
RUN pip install --constraint docker/constraints.txt ".[service,otel,usd]"

FROM python:3.11.14-slim-bookworm
# The same user id in both images: the API and the workers may share a folder of stored objects.
# Uploads under way lie in /data/tmp: on the volume, not in the memory that a tmpfs is.
RUN useradd --uid 10001 --no-create-home --shell /usr/sbin/nologin meshdeform \
    && install -d -o meshdeform -g meshdeform /data /data/tmp
COPY --from=build /opt/meshdeform /opt/meshdeform
ENV PATH=/opt/meshdeform/bin:$PATH \
    PYTHONUNBUFFERED=1 \
    PYTHONDONTWRITEBYTECODE=1 \
    TMPDIR=/data/tmp \
    MESHDEFORM_DATA_DIR=/data \
    MESHDEFORM_CACHE_DIR=/data/cache
USER 10001:10001
WORKDIR /data
VOLUME /data
EXPOSE 8765
HEALTHCHECK --interval=10s --timeout=3s --start-period=15s --retries=3 \
    CMD ["python", "-c", "import urllib.request; urllib.request.urlopen('http://127.0.0.1:8765/healthz', timeout=2)"]
CMD ["meshdeform", "api", "--host", "0.0.0.0", "--port", "8765"]
