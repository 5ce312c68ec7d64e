# The command line in a small image:
#
#   docker build -t stillpoint .
#   docker run --rm -v "$PWD:/data" -u "$(id -u):$(id -g)" stillpoint run walk.mcap
#
# Releases are made of these bases as they were when `tools/images` wrote their digests behind the names (docs/release.md).
FROM rust:1.94-slim-bookworm AS build
WORKDIR /stillpoint
COPY . .
RUN cargo build --profile dist --locked --package stillpoint-cli

# The C library and nothing else: no shell, no packages.
FROM gcr.io/distroless/cc-debian12:nonroot
COPY --from=build /stillpoint/target/dist/stillpoint /usr/local/bin/stillpoint
COPY --from=build /stillpoint/LICENSE-MIT /stillpoint/LICENSE-APACHE /stillpoint/NOTICES.md /usr/share/doc/stillpoint/
# Models that are pulled stay where recordings and results are.
ENV XDG_CACHE_HOME=/data/.cache
WORKDIR /data
# Nobody: as root, an output named carelessly could replace a device of the machine.
USER 65532:65532
ENTRYPOINT ["/usr/local/bin/stillpoint"]
CMD ["--help"]
