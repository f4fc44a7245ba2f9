# The daemon in a container: a statically linked program and its configurations on an empty base, as a user without rights.
#
#   docker build -t upm .
#   openssl rand -hex 32 > token
#   docker run -p 127.0.0.1:8750:8750 -v upm-data:/data -v ./token:/run/secrets/token:ro upm
#
# Beyond loopback every request needs the token, so the container does not start without one. The token file must be
# readable for user 65532.
FROM rust:1.95-slim-bookworm AS build
WORKDIR /src
COPY . .
RUN RUSTFLAGS="-C target-feature=+crt-static" \
    cargo build --profile dist --locked --target x86_64-unknown-linux-gnu --bin upm \
 && mkdir -p /image/usr/bin /image/usr/share/upm/assets /image/data /image/tmp \
 && cp target/x86_64-unknown-linux-gnu/dist/upm /image/usr/bin/ \
 && cp -r configs /image/usr/share/upm/ \
 && cp -r assets/libraries /image/usr/share/upm/assets/

FROM scratch
COPY --from=build --chown=65532:65532 /image /
USER 65532:65532
ENV UPM_TOKEN_FILE=/run/secrets/token
VOLUME /data
EXPOSE 8750
STOPSIGNAL SIGTERM
HEALTHCHECK --interval=10s --timeout=5s --start-period=60s CMD ["/usr/bin/upm", "plates", "--quiet"]
ENTRYPOINT ["/usr/bin/upm"]
CMD ["serve", "--config", "/usr/share/upm/configs/daemon-container.json"]
