//! Datagrams, receivers and the operators of this family.

#![allow(clippy::unwrap_used, clippy::panic)]

mod claims;
