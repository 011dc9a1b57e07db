# thermap as an image: docker build -t thermap . && docker run -p 127.0.0.1:8000:8000 -v thermap:/data thermap
# The Python that the tests run on; what is installed is locked (requirements.lock), with hashes.
FROM python:3.11-slim-bookworm AS build
ENV PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1
WORKDIR /source
COPY requirements.lock requirements-build.lock ./
RUN ["python", "-m", "venv", "/opt/thermap"]
RUN ["/opt/thermap/bin/pip", "install", "--no-deps", "--require-hashes", "--only-binary=:all:", "-r", "requirements.lock"]
RUN ["python", "-m", "venv", "/opt/builder"]
RUN ["/opt/builder/bin/pip", "install", "--no-deps", "--require-hashes", "--only-binary=:all:", "-r", "requirements-build.lock"]
COPY pyproject.toml README.md ./
COPY thermap thermap
COPY migrations migrations
COPY app app
RUN ["/opt/builder/bin/python", "-m", "hatchling", "build", "-t", "wheel", "-d", "/wheel"]
RUN ["/opt/thermap/bin/pip", "install", "--no-deps", "--no-index", "--find-links", "/wheel", "thermap"]
RUN ["/opt/thermap/bin/pip", "check"]

FROM python:3.11-slim-bookworm
COPY --from=build /opt/thermap /opt/thermap
# A new volume takes over whose folder this is.
RUN ["install", "-d", "-m", "0750", "-o", "10001", "-g", "10001", "/data"]
ENV PATH=/opt/thermap/bin:/usr/local/bin:/usr/bin:/bin \
    PYTHONDONTWRITEBYTECODE=1 \
    PYTHONUNBUFFERED=1 \
    THERMAP_HOST=0.0.0.0 \
    THERMAP_PORT=8000 \
    THERMAP_DATABASE_URL=sqlite:////data/thermap.db
WORKDIR /data
VOLUME /data
USER 10001:10001
EXPOSE 8000
# Whether the process answers: live tables go on while the database is away (that is /readyz).
HEALTHCHECK --interval=10s --timeout=5s --start-period=60s --retries=3 \
    CMD ["python", "-c", "import os, urllib.request as u; u.urlopen('http://127.0.0.1:' + os.environ['THERMAP_PORT'] + '/healthz', timeout=4)"]
ENTRYPOINT ["thermap"]
CMD ["serve"]
