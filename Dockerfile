# The command line in a small image:
#
#   docker build -t stillpoint .
#   docker run --rm -v "$PWD:/data" -u "$(id -u):$(id -g)" stillpoint run walk.mcap
#
# For releases `tools/images` pins the base images by their digests (docs/release.md).
FROM rust:1.94-slim-bookworm AS build
WORKDIR /stillpoint
COPY . .
RUN cargo build --profile dist --locked --package stillpoint-cli

# Only the C library: no shell, no packages.
FROM gcr.io/distroless/cc-debian12:nonroot
COPY --from=build /stillpoint/target/dist/stillpoint /usr/local/bin/stillpoint
COPY --from=build /stillpoint/LICENSE-MIT /stillpoint/LICENSE-APACHE /stillpoint/NOTICES.md /usr/share/doc/stillpoint/
# Stores downloaded models beside recordings and results.
ENV XDG_CACHE_HOME=/data/.cache
WORKDIR /data
# Unprivileged: as root, a wrong output path could replace a device file.
USER 65532:65532
ENTRYPOINT ["/usr/local/bin/stillpoint"]
CMD ["--help"]
