//! Whole plans: what is wanted, doses, fluence, figures.

mod checked;
mod published;
mod setups;
