//! Leaf sequencing: of drawn fluences, and of plans.

mod maps;
mod plans;
