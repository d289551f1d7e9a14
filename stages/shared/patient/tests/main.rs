//! Cases: their file, and what they are read from.

#![allow(clippy::unwrap_used, clippy::panic)]

mod case;
