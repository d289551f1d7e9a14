//! Cameras placed over the couch, in rendered images with the errors of real cameras.

#![allow(clippy::unwrap_used, clippy::panic)]

mod balls;
mod board;
mod edges;
