//! Valves and beam: what leaves the program, and what forbids it.

#![forbid(unsafe_code)]
