# What people do here most. `just` lists the recipes; each is one command that can be typed without it, too.

# List the recipes.
default:
    @just --list

# Run the default pipeline for 20 seconds and record it.
run *ARGUMENTS:
    cargo run --release -- {{ARGUMENTS}}

# Test functions, checker, operators and the command: about 3 minutes after the build.
test:
    cargo test

# Test everything but runs on several hosts.
test-all:
    cargo test --workspace

# Do what CI does: tests, format, lints, docs, dependencies, the main job, the examples.
ci:
    .ci/run

# Format and lint.
lint:
    cargo fmt --all
    cargo clippy --workspace --all-targets -- -D warnings

# Write the generated pages and expected messages anew; read their difference.
bless:
    BLESS=1 cargo test -p stillpoint --test command generated_pages
    BLESS=1 cargo test -p stillpoint-pipeline --test config broken

# Build the program that connects hosts (zenoh) next to the command.
bridge:
    cargo build --release --manifest-path tools/bridge/Cargo.toml --target-dir target

# Build the release: a tarball and a Debian package under target/release-files.
release:
    packaging/release
