//! The estimators against vectors, properties and recorded sequences, and their operators on the bench.

#![allow(clippy::unwrap_used, clippy::panic)]

mod claims;
