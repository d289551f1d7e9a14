//! The `stillpoint` command with the kit's operators, and those of the Rust examples.

#[path = "../../examples/own_control_law.rs"]
mod own_control_law;
#[path = "../../examples/own_operator.rs"]
mod own_operator;

fn main() -> std::process::ExitCode {
    stillpoint::command(&[stillpoint_tests::STAGES, own_operator::MY_STAGES, own_control_law::MY_LAWS])
}
