//! Whole plans: what is wanted, doses, fluence, figures.

mod published;
mod setups;
