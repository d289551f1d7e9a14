//! Whole plans: what is wanted, doses, fluence, figures.

mod checked;
mod couch;
mod published;
mod setups;
