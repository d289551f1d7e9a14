//! The controllers against vectors and properties, their operators on the bench, and loops that they close.

#![allow(clippy::unwrap_used, clippy::panic)]

mod claims;
