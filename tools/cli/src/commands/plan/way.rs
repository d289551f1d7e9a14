//! The names of the methods of choosing beams.

use clap::ValueEnum;
use serde::Serialize;

/// A method of choosing beams.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Way {
    /// Equally spaced beams; every rotation is tried.
    Equidistant,
    /// The usual angles for the pelvis with 5 or 7 beams; equally spaced beams for other numbers.
    Class,
    /// The best of uniformly drawn sets.
    Random,
    /// Beams are added one by one, by price.
    Greedy,
    /// Exchanges single beams as long as the objective improves, priced beside the beams that stay; starts from class
    /// solutions or rotations, then from random sets.
    Exchange,
    /// Simulated annealing: starts from the greedy set and makes random exchanges.
    Annealing,
    /// Column generation: adds beams by price beyond the requested number, removes those with the least weight, and repeats.
    Columns,
    /// Tree search over exchanges, guided by `--prior`.
    Search,
    /// The set that the prior builds by itself: one solve.
    Prior,
    /// The sets that a trained network proposes from the image alone, the best first, as many as `--budget` says; only their
    /// beams get doses.
    Network,
    /// Tree search of the game in which beams are added one by one.
    Construction,
    /// Tree search of the game in which two players exchange beams in turn: one for a low objective, one for a high one.
    TwoPlayer,
    /// The angles of the command line.
    #[value(skip)]
    Given,
}

impl Way {
    /// The methods that run a search.
    pub const CHOOSING: [Self; 9] = [
        Self::Equidistant,
        Self::Class,
        Self::Random,
        Self::Greedy,
        Self::Exchange,
        Self::Annealing,
        Self::Columns,
        Self::Search,
        Self::Network,
    ];

    /// Whether it uses what is known of beams before they are solved.
    pub fn takes_prior(self) -> bool {
        matches!(self, Self::Search | Self::Prior | Self::Construction | Self::TwoPlayer)
    }

    /// Its name.
    pub fn word(self) -> &'static str {
        match self {
            Self::Equidistant => "equidistant",
            Self::Class => "class",
            Self::Random => "random",
            Self::Greedy => "greedy",
            Self::Exchange => "exchange",
            Self::Annealing => "annealing",
            Self::Columns => "columns",
            Self::Search => "search",
            Self::Prior => "prior",
            Self::Network => "network",
            Self::Construction => "construction",
            Self::TwoPlayer => "two-player",
            Self::Given => "given",
        }
    }
}
