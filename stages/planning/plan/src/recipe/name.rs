//! The names of the methods of choosing beams, and of the priors.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// A method of choosing beams.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MethodName {
    /// Equally spaced beams; every rotation is tried.
    Equidistant,
    /// The usual angles for the pelvis.
    Class,
    /// The best of uniformly drawn sets.
    Random,
    /// Beams are added one by one, by price.
    Greedy,
    /// Single beams are exchanged as long as the objective improves.
    Exchange,
    /// Simulated annealing.
    Annealing,
    /// Column generation.
    Columns,
    /// Tree search over exchanges.
    Search,
    /// The set that the prior builds by itself.
    Prior,
    /// The sets that a trained network proposes.
    Network,
    /// Tree search of the game in which beams are added one by one.
    Construction,
    /// Tree search of the game in which two players exchange beams in turn.
    TwoPlayer,
    /// The angles of the request; nothing is searched.
    Given,
}

/// What is known of a beam before it is solved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PriorName {
    /// All beams are alike.
    Uniform,
    /// Prices beside the beams that stay; they take solves of smaller sets.
    Price,
    /// Path lengths through the body and through organs, from the image alone.
    Geometry,
    /// The usual angles for the pelvis with 5 or 7 beams.
    Class,
    /// A trained network over the geometry of the case.
    Network,
}

/// A text that is not a name.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("unknown {what}: {found} (allowed: {allowed})")]
pub struct UnknownName {
    /// What it should name.
    pub what: &'static str,
    /// The text.
    pub found: String,
    /// The names, separated by commas.
    pub allowed: String,
}

impl MethodName {
    /// Every method that a request can name, in the order of the documents.
    pub const ALL: [Self; 12] = [
        Self::Equidistant,
        Self::Class,
        Self::Random,
        Self::Greedy,
        Self::Exchange,
        Self::Annealing,
        Self::Columns,
        Self::Search,
        Self::Prior,
        Self::Network,
        Self::Construction,
        Self::TwoPlayer,
    ];

    /// The methods that a comparison runs.
    pub const COMPARED: [Self; 9] = [
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

    /// Whether the method uses a prior.
    pub fn takes_prior(self) -> bool {
        matches!(self, Self::Search | Self::Prior | Self::Construction | Self::TwoPlayer)
    }

    /// Whether the method can have several leaves under way.
    pub fn looks_ahead(self) -> bool {
        matches!(self, Self::Exchange | Self::Search)
    }

    /// The name.
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

    /// What the method does, for help texts.
    pub fn about(self) -> &'static str {
        match self {
            Self::Equidistant => "Equally spaced beams; every rotation is tried",
            Self::Class => {
                "The usual angles for the pelvis with 5 or 7 beams; equally spaced beams for other numbers"
            }
            Self::Random => "The best of uniformly drawn sets",
            Self::Greedy => "Beams are added one by one, by price",
            Self::Exchange => {
                "Exchanges single beams as long as the objective improves, priced against the beams that stay; starts from class solutions or rotations, then from random sets"
            }
            Self::Annealing => "Simulated annealing: starts from the greedy set and makes random exchanges",
            Self::Columns => {
                "Column generation: adds beams by price beyond the requested number, removes those with the least weight, and repeats"
            }
            Self::Search => "Tree search over exchanges, guided by `--prior`",
            Self::Prior => "The set that the prior builds by itself: one solve",
            Self::Network => {
                "The sets that a trained network proposes from the image alone, the best first, as many as `--budget` says; only their beams get doses"
            }
            Self::Construction => "Tree search of the game in which beams are added one by one",
            Self::TwoPlayer => {
                "Tree search of the game in which two players exchange beams in turn: one for a low objective, one for a high one"
            }
            Self::Given => "The angles of the request",
        }
    }
}

impl PriorName {
    /// Every prior, in the order of the documents.
    pub const ALL: [Self; 5] = [Self::Uniform, Self::Price, Self::Geometry, Self::Class, Self::Network];

    /// The name.
    pub fn word(self) -> &'static str {
        match self {
            Self::Uniform => "uniform",
            Self::Price => "price",
            Self::Geometry => "geometry",
            Self::Class => "class",
            Self::Network => "network",
        }
    }

    /// What the prior is, for help texts.
    pub fn about(self) -> &'static str {
        match self {
            Self::Uniform => "All beams are alike",
            Self::Price => "Prices against the beams that stay; this takes solves of smaller sets",
            Self::Geometry => "Ways through the body and through organs, from the image alone",
            Self::Class => "The usual angles for the pelvis with 5 or 7 beams",
            Self::Network => {
                "A trained network over the geometry of the case: the one that comes with stillpoint, or that of `--network`"
            }
        }
    }
}

impl FromStr for MethodName {
    type Err = UnknownName;

    fn from_str(text: &str) -> Result<Self, UnknownName> {
        let found = Self::ALL.into_iter().find(|name| name.word() == text);
        found.ok_or_else(|| unknown("method", text, Self::ALL.map(Self::word).join(", ")))
    }
}

impl FromStr for PriorName {
    type Err = UnknownName;

    fn from_str(text: &str) -> Result<Self, UnknownName> {
        let found = Self::ALL.into_iter().find(|name| name.word() == text);
        found.ok_or_else(|| unknown("prior", text, Self::ALL.map(Self::word).join(", ")))
    }
}

impl fmt::Display for MethodName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}

impl fmt::Display for PriorName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}

fn unknown(what: &'static str, text: &str, allowed: String) -> UnknownName {
    UnknownName { what, found: text.to_owned(), allowed }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_is_read_from_its_own_word() {
        for name in MethodName::ALL {
            assert_eq!(name.word().parse(), Ok(name));
        }
        for name in PriorName::ALL {
            assert_eq!(name.word().parse(), Ok(name));
        }
        let unknown = "given".parse::<MethodName>().unwrap_err().to_string();
        assert!(unknown.starts_with("unknown method: given (allowed: equidistant, class"), "{unknown}");
    }
}
