//! The kit's operators and the control laws as a program, which pipelines start.

fn main() -> std::process::ExitCode {
    let stages = [stillpoint_tests::STAGES, stillpoint_control::STAGES].concat();
    stillpoint_operator::program::main(stages.leak())
}
