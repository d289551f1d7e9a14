//! stillpoint
