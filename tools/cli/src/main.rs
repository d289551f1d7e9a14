//! The `stillpoint` command with the kinds of operators that come with it.

fn main() -> std::process::ExitCode {
    stillpoint::command(&[])
}
