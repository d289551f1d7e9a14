//! A player: a process that plays the games that a training gives it, line by line, until its input ends.

use std::io::{BufRead, Write};
use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::Args;
use serde::{Deserialize, Serialize};
use stillpoint_network::game::play;
use stillpoint_network::{Due, Game};
use stillpoint_shm::Domain;

use super::weights::Receiver;
use stillpoint::{Ended, Exit, Failure};

/// Play games for `stillpoint-research train planner`, which starts its players itself.
#[derive(Args)]
pub struct Player {
    /// Root folder of the domain of the training.
    #[arg(long)]
    root: PathBuf,
    /// Its prefix.
    #[arg(long)]
    prefix: String,
}

/// A line to a player.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Order {
    /// The game.
    pub due: Due,
    /// Hash of the weights to play with; none for an opening.
    pub network: Option<String>,
}

/// A line from a player.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum PlayerMessage {
    /// It has joined the topic of the weights, and waits for an order.
    Ready,
    /// The game of its order has ended.
    Played(Box<Game>),
    /// The game cannot be played by anybody.
    Failed(String),
}

impl Player {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        let name = format!("player-{}", std::process::id());
        let domain = Domain::join(&self.root, &self.prefix, &name).map_err(Failure::failed)?;
        let mut weights = Receiver::new(&domain)?;
        say(&PlayerMessage::Ready)?;
        for line in std::io::stdin().lock().lines() {
            // A line that was cut off is of a training that has died.
            let Ok(order) = serde_json::from_str::<Order>(&line.map_err(Failure::failed)?) else { break };
            let played = match played(&order, &mut weights) {
                Ok(game) => PlayerMessage::Played(Box::new(game)),
                Err(failure) => PlayerMessage::Failed(failure.text),
            };
            say(&played)?;
        }
        Ok(Exit::Done)
    }
}

fn played(order: &Order, weights: &mut Receiver) -> Result<Game, Failure> {
    let network = match &order.network {
        None => None,
        Some(requested) => {
            let newest = weights.newest()?;
            let newest = newest.ok_or_else(|| Failure::failed("no weights have come"))?;
            if newest.hash().map_err(Failure::failed)? != *requested {
                return Err(Failure::failed("the newest weights are not those of the order"));
            }
            Some(newest)
        }
    };
    let due = &order.due;
    play(network, &due.patient, due.seed, due.rules, NonZeroUsize::MIN).map_err(Failure::failed)
}

fn say(message: &PlayerMessage) -> Result<(), Failure> {
    let line = serde_json::to_string(message).map_err(Failure::failed)?;
    let mut out = std::io::stdout().lock();
    writeln!(out, "{line}").and_then(|()| out.flush()).map_err(Failure::failed)
}
