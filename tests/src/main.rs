//! The `stillpoint` command with the kit's operators.

fn main() -> std::process::ExitCode {
    stillpoint::command(&[stillpoint_tests::STAGES])
}
