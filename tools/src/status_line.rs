//! The live status line of a run.

use std::io::{IsTerminal, Write};

use stillpoint_pipeline::live::Fault;
use stillpoint_pipeline::live::status::OperatorFigures;

/// The live status line, on a terminal.
pub struct StatusLine {
    terminal: bool,
    shown: bool,
}

impl StatusLine {
    /// A status line on standard error, where that is a terminal and `wanted`.
    pub fn new(wanted: bool) -> Self {
        Self { terminal: wanted && std::io::stderr().is_terminal(), shown: false }
    }

    /// Takes the line away.
    pub fn clear(&mut self) {
        if self.shown {
            eprint!("\r\x1b[2K");
            self.shown = false;
        }
    }
}

impl stillpoint_pipeline::live::Run for StatusLine {
    fn started(&mut self, _: &[(String, u32)]) {}

    fn goes_on(&mut self, seconds: f64, operators: &[OperatorFigures]) {
        if !self.terminal {
            return;
        }
        let mut line = format!("{seconds:6.1} s");
        for o in operators.iter().filter(|o| o.activations > 0) {
            line += &format!("  {} {:.0} Hz", o.operator, o.rate_hz);
            if o.step_ms[0].is_finite() {
                line += &format!(" {:.1} ms", o.step_ms[0]);
            }
            if o.lost > 0 {
                line += &format!(" lost {}", o.lost);
            }
            if o.errors + o.panics > 0 {
                line += &format!(" failed {}", o.errors + o.panics);
            }
        }
        let width =
            rustix::termios::tcgetwinsize(std::io::stderr()).map_or(80, |w| usize::from(w.ws_col).max(20));
        let line: String = line.chars().take(width - 1).collect();
        eprint!("\r\x1b[2K{line}");
        let _ = std::io::stderr().flush();
        self.shown = true;
    }

    fn failed(&mut self, fault: &Fault) {
        self.clear();
        eprintln!("stillpoint: {}: {}", fault.operator, fault.reason);
    }
}
