//! The `stillpoint` command with the kit's operators, and that of the page "write your own operator".

#[path = "../../examples/own_operator.rs"]
mod own_operator;

fn main() -> std::process::ExitCode {
    stillpoint::command(&[stillpoint_tests::STAGES, own_operator::MY_STAGES])
}
