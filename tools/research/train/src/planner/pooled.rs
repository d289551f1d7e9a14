//! Players that are the workers of a pool.

use std::num::NonZeroUsize;

use stillpoint_network::{Due, Model};
use stillpoint_pool::{CallError, Courier, Pool, PoolGames};

use super::plan;
use super::players::{Done, Players};
use crate::TrainError;

/// Workers of a pool play, and this process where none is there.
pub struct Pooled<C: Courier> {
    pool: Pool<C>,
    games: PoolGames,
}

impl<C: Courier> Pooled<C> {
    /// On this pool. A game that this process plays takes so many threads.
    pub fn new(pool: Pool<C>, threads: NonZeroUsize) -> Self {
        Self { pool, games: PoolGames::new(threads) }
    }

    pub fn pool(&mut self) -> &mut Pool<C> {
        &mut self.pool
    }
}

impl<C: Courier> Players for Pooled<C> {
    fn play(&mut self, network: Option<&Model>, due: &[Due], done: Done<'_>) -> Result<(), TrainError> {
        let mut failed = None;
        let doubtful = self.games.play(&mut self.pool, network, due, &mut |place, game| {
            done(place, game).map_err(|e| {
                let ended = CallError::Fault(e.to_string().into());
                failed = Some(e);
                ended
            })
        });
        match (failed, doubtful) {
            (Some(e), _) => Err(e),
            (None, Err(why)) => Err(plan(why)),
            (None, Ok(names)) if names.is_empty() => Ok(()),
            (None, Ok(names)) => Err(TrainError::Doubtful(names)),
        }
    }
}
