# The API. No torch inside: it takes requests, checks files, and tells the workers.
#
#   docker build -f docker/service.Dockerfile -t meshdeform-service .
FROM python:3.11-slim-bookworm AS build
ENV PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1
RUN python -m venv /opt/meshdeform
ENV PATH=/opt/meshdeform/bin:$PATH
WORKDIR /src
COPY pyproject.toml README.md LICENSE ./
COPY meshdeform meshdeform
COPY service service
COPY worker worker
RUN pip install ".[service]"

FROM python:3.11-slim-bookworm
# The same user id in both images: the API and the workers share the folder of stored objects.
RUN useradd --uid 10001 --no-create-home --shell /usr/sbin/nologin meshdeform \
    && install -d -o meshdeform -g meshdeform /data
COPY --from=build /opt/meshdeform /opt/meshdeform
ENV PATH=/opt/meshdeform/bin:$PATH \
    PYTHONUNBUFFERED=1 \
    MESHDEFORM_DATA_DIR=/data
USER meshdeform
WORKDIR /data
VOLUME /data
EXPOSE 8765
HEALTHCHECK --interval=10s --timeout=3s --start-period=15s --retries=3 \
    CMD ["python", "-c", "import urllib.request; urllib.request.urlopen('http://127.0.0.1:8765/healthz', timeout=2)"]
CMD ["meshdeform", "api", "--host", "0.0.0.0", "--port", "8765"]
