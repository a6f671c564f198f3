# needle_twin in a container. The network is used by two steps only, each of which is pinned by the lock file or by the base image:
# the base images are pulled, and the crates of Cargo.lock are fetched. The build itself runs without a network.
#
#   docker build -t needle_twin .
#   docker run --rm --user "$(id -u)" -v "$PWD/out:/out" needle_twin solve --scene needle_insertion --out /out/solve
#   docker run --rm --network host --cap-add SYS_PTRACE --entrypoint twin_node needle_twin --ros-args -p page:=true
#
# --network host: the nodes are for one machine, and a container with a network of its own is another.
# SYS_PTRACE: the nodes keep their sockets to the machine by pidfd_getfd, which Docker permits with this capability only.

FROM rust:1.89-slim-bookworm AS build
WORKDIR /src
COPY . .
RUN cargo fetch --locked
RUN --network=none cargo build --release --locked --offline --bins

FROM debian:bookworm-slim
COPY --from=build /src/target/release/needle_twin /src/target/release/twin_node /src/target/release/rig_node /usr/local/bin/
COPY --from=build /src/LICENSE-MIT /src/LICENSE-APACHE /usr/local/share/doc/needle_twin/
RUN useradd --create-home --uid 1000 twin
USER twin
WORKDIR /home/twin
# As Ctrl-C: recordings are closed.
STOPSIGNAL SIGINT
ENTRYPOINT ["needle_twin"]
