//! Players as processes. One that dies is started again, and its game is given out anew: a game depends on its order alone.

use std::io::{BufRead, BufReader, Write};
use std::num::NonZeroUsize;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, Sender, channel};

use stillpoint_network::{Due, Model};
use stillpoint_pipeline::live::run_folder::{RunFolder, sweep_dead};
use stillpoint_shm::Domain;
use stillpoint_train::TrainError;
use stillpoint_train::planner::{Done, Players, not_played};

use super::player::{Order, PlayerMessage};
use super::weights;
use stillpoint::Failure;

/// Exits of players during one game after which the training ends.
const PATIENCE: usize = 3;

pub struct Workers {
    players: Vec<Option<Player>>,
    weights: weights::Sender,
    sender: Sender<Received>,
    received: Receiver<Received>,
    /// Number of the next process.
    next: usize,
    domain: Domain,
    /// Dropped last: it removes what the domain left.
    folder: RunFolder,
}

/// A line of a process, or none at its end.
struct Received {
    process: usize,
    line: Option<String>,
}

struct Player {
    process: usize,
    child: Child,
    input: ChildStdin,
    /// Place of its game among those that are due.
    game: Option<usize>,
}

impl Workers {
    /// So many, started when there is something to play.
    pub fn new(count: NonZeroUsize) -> Result<Self, Failure> {
        sweep_dead().map_err(Failure::failed)?;
        let folder = RunFolder::create().map_err(Failure::failed)?;
        let domain = Domain::create(&folder.root(), folder.prefix(), "training").map_err(Failure::failed)?;
        let weights = weights::Sender::new(&domain)?;
        let (sender, received) = channel();
        let players = (0..count.get()).map(|_| None).collect();
        Ok(Self { players, weights, sender, received, next: 0, domain, folder })
    }

    fn start(&mut self) -> Result<Player, Failure> {
        let program = std::env::current_exe().map_err(Failure::failed)?;
        let mut child = Command::new(program)
            .args(["train", "player", "--prefix", self.folder.prefix(), "--root"])
            .arg(self.folder.root())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|e| Failure::failed(format!("a player cannot be started: {e}")))?;
        let (input, output) = (child.stdin.take(), child.stdout.take());
        let (Some(input), Some(output)) = (input, output) else {
            return Err(Failure::failed("a player has no pipes"));
        };
        let (process, sender) = (self.next, self.sender.clone());
        self.next += 1;
        std::thread::spawn(move || {
            for line in BufReader::new(output).lines().map_while(Result::ok) {
                if sender.send(Received { process, line: Some(line) }).is_err() {
                    return;
                }
            }
            let _ = sender.send(Received { process, line: None });
        });
        Ok(Player { process, child, input, game: None })
    }

    fn run(&mut self, network: Option<&Model>, due: &[Due], done: Done<'_>) -> Result<(), TrainError> {
        let hash = network.map(Model::hash).transpose().map_err(|e| fault(&e))?;
        if let Some(network) = network {
            self.weights.send(network).map_err(|e| fault(&e.text))?;
        }
        // The last is given out first.
        let mut waiting: Vec<usize> = (0..due.len()).rev().collect();
        let (mut exits, mut failed_starts) = (vec![0; due.len()], 0);
        for at in 0..self.players.len() {
            if self.players[at].is_some() {
                self.give(at, &mut waiting, due, hash.as_deref());
            } else if waiting.len() > at {
                self.players[at] = Some(self.start().map_err(|e| fault(&e.text))?);
            }
        }
        let mut left = due.len();
        while left > 0 {
            let received = self.received.recv().map_err(|e| fault(&e))?;
            let Some(at) = self.place(received.process) else { continue };
            match received.line.map(|line| serde_json::from_str(&line)) {
                Some(Ok(PlayerMessage::Ready)) => {
                    failed_starts = 0;
                    self.weights.connect().map_err(|e| fault(&e.text))?;
                    self.give(at, &mut waiting, due, hash.as_deref());
                }
                Some(Ok(PlayerMessage::Played(game))) => {
                    let Some(place) = self.players[at].as_mut().and_then(|player| player.game.take()) else {
                        continue;
                    };
                    left -= 1;
                    done(place, *game)?;
                    self.give(at, &mut waiting, due, hash.as_deref());
                }
                Some(Ok(PlayerMessage::Failed(why))) => {
                    let game = self.players[at].as_ref().and_then(|player| player.game);
                    return Err(game.map_or_else(|| fault(&why), |place| not_played(&due[place], &why)));
                }
                // It has exited, or its line was cut off.
                Some(Err(_)) | None => {
                    match self.reap(at) {
                        Some(place) => {
                            exits[place] += 1;
                            if exits[place] >= PATIENCE {
                                let why = format!("its players ended {PATIENCE} times before it was played");
                                return Err(not_played(&due[place], why));
                            }
                            waiting.push(place);
                        }
                        None => {
                            failed_starts += 1;
                            if failed_starts >= PATIENCE * self.players.len() {
                                return Err(fault(&"they end before they are ready"));
                            }
                        }
                    }
                    self.players[at] = Some(self.start().map_err(|e| fault(&e.text))?);
                }
            }
        }
        Ok(())
    }

    fn place(&self, process: usize) -> Option<usize> {
        self.players.iter().position(|player| player.as_ref().is_some_and(|p| p.process == process))
    }

    /// Gives a player the next game. One that has died is found by the end of its output.
    fn give(&mut self, at: usize, waiting: &mut Vec<usize>, due: &[Due], network: Option<&str>) {
        let (Some(player), Some(place)) = (self.players[at].as_mut(), waiting.pop()) else { return };
        player.game = Some(place);
        let order = Order { due: due[place].clone(), network: network.map(str::to_owned) };
        if let Ok(line) = serde_json::to_string(&order) {
            let _ = writeln!(player.input, "{line}").and_then(|()| player.input.flush());
        }
    }

    /// Ends a process, gives back what it held in shared memory, and gives the game that it had.
    fn reap(&mut self, at: usize) -> Option<usize> {
        let mut player = self.players[at].take()?;
        let _ = player.child.kill();
        let _ = player.child.wait();
        self.domain.clean_dead_nodes(&[]);
        player.game
    }
}

impl Players for Workers {
    fn play(&mut self, network: Option<&Model>, due: &[Due], done: Done<'_>) -> Result<(), TrainError> {
        self.run(network, due, done)
    }
}

impl Drop for Workers {
    fn drop(&mut self) {
        (0..self.players.len()).for_each(|at| {
            self.reap(at);
        });
    }
}

fn fault(why: &dyn std::fmt::Display) -> TrainError {
    TrainError::Plan(format!("the players: {why}"))
}
