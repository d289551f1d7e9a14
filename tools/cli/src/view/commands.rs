//! Commands of the page. They need the token that is printed when the page is opened for commands, and each is the command
//! `stillpoint send` in a process of its own, with its checks and confirmations.

use std::io::Read;
use std::process::{Command, Stdio};
use std::sync::{Mutex, PoisonError};

use serde::Deserialize;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use stillpoint_pipeline::program::Program;

/// Longest word of a command.
const LONGEST: usize = 64;
/// Most values of a command.
const VALUES: usize = 6;

/// The right to send commands to one run.
pub struct Commands {
    token: String,
    run: u32,
    /// One command at a time.
    turn: Mutex<()>,
}

/// What a page asks for.
#[derive(Debug, Deserialize)]
struct Asked {
    /// Console and verb, such as `console.arm`.
    command: String,
    /// The values, as `send` reads them.
    #[serde(default)]
    values: Vec<String>,
}

/// Why a command of the page was not sent.
#[derive(Debug, thiserror::Error)]
pub enum CommandError {
    /// It has no token, or another one.
    #[error("the command needs the token that `stillpoint view --commands` printed")]
    Token,
    /// It is none.
    #[error(
        "invalid command: {0} (allowed: a console and a verb such as console.arm, and up to {VALUES} values)"
    )]
    Invalid(String),
    /// `stillpoint send` cannot be started.
    #[error("`stillpoint send` cannot be started: {0}")]
    Start(#[from] std::io::Error),
}

impl Commands {
    /// Commands to the run of this supervisor, with a new token.
    ///
    /// # Errors
    /// The system gives no random numbers.
    pub fn to(run: u32) -> std::io::Result<Self> {
        let mut bytes = [0_u8; 16];
        std::fs::File::open("/dev/urandom")?.read_exact(&mut bytes)?;
        let token = bytes.iter().map(|b| format!("{b:02x}")).collect();
        Ok(Self { token, run, turn: Mutex::new(()) })
    }

    /// The token.
    pub fn token(&self) -> &str {
        &self.token
    }

    /// Sends the command of a request, and gives what `send` printed and whether it was taken.
    ///
    /// # Errors
    /// The token is another one, or the command is none.
    pub fn send(&self, token: &str, body: &str) -> Result<Value, CommandError> {
        // Digests are compared: the time of a comparison says nothing of the token.
        if Sha256::digest(token) != Sha256::digest(&self.token) {
            return Err(CommandError::Token);
        }
        let asked: Asked =
            serde_json::from_str(body).map_err(|error| CommandError::Invalid(error.to_string()))?;
        let asked = asked.checked()?;
        let _turn = self.turn.lock().unwrap_or_else(PoisonError::into_inner);
        let program = Program::here()?;
        let done = Command::new(program.executable)
            .args(program.lead)
            .envs(program.environment)
            .args(["send", "--run", &self.run.to_string(), "--", &asked.command])
            .args(&asked.values)
            .stdin(Stdio::null())
            .output()?;
        let lines = [done.stdout, done.stderr].concat();
        Ok(json!({ "taken": done.status.success(), "text": String::from_utf8_lossy(&lines).trim_end() }))
    }
}

impl Asked {
    /// A command whose words are only words and numbers.
    fn checked(self) -> Result<Self, CommandError> {
        let is_word = |text: &str, more: &str| {
            !text.is_empty()
                && text.len() <= LONGEST
                && text.chars().all(|c| c.is_ascii_alphanumeric() || more.contains(c))
        };
        let is_value =
            |text: &String| is_word(text, "_") || (is_word(text, "+-.") && text.parse::<f64>().is_ok());
        if !is_word(&self.command, "_-.") || self.command.starts_with('-') {
            return Err(CommandError::Invalid(format!("{:?}", self.command)));
        }
        match self.values.iter().find(|value| !is_value(value)) {
            Some(value) => Err(CommandError::Invalid(format!("{value:?}"))),
            None if self.values.len() > VALUES => {
                Err(CommandError::Invalid(format!("{} values", self.values.len())))
            }
            None => Ok(self),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_without_the_token_or_with_an_option_in_it_is_refused() {
        let commands = Commands::to(1).unwrap();
        assert_eq!(commands.token().len(), 32);
        assert_ne!(commands.token(), Commands::to(1).unwrap().token());
        let refused = |token: &str, body: &str| commands.send(token, body).unwrap_err().to_string();
        for token in ["", "0", &commands.token()[..31]] {
            assert!(refused(token, r#"{"command":"console.arm"}"#).contains("needs the token"));
        }
        let token = commands.token();
        for body in [
            "{}",
            r#"{"command":"--help"}"#,
            r#"{"command":"console.arm; rm"}"#,
            r#"{"command":"console.target","values":["--run"]}"#,
            r#"{"command":"console.target","values":["1","2","3","4","5","6","7"]}"#,
        ] {
            assert!(refused(token, body).starts_with("invalid command"), "{body}");
        }
    }
}
