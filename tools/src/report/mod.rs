//! `stillpoint report`: a session as one page that needs nothing else, or as JSON.
//!
//! A session is read once ([`recording`]), each section makes figures of it and then blocks ([`page`]) of the figures,
//! and the blocks become HTML. A new section is a file in [`sections`] and a line in its list.
//!
//! - `command`: the subcommand
//! - `recording`, `rows`, `wiring`, `thinned`: what is read of a session; small samples over time; who feeds whom; long
//!   rows in bounded memory
//! - `motion`, `statistics`: estimates against the truth; plain numbers
//! - `ramp`: what the gains of a filter do to noise and to a ramp
//! - `views`, `again`, `overlay`: images with what was found in them; what had to be made again; the same as pictures
//! - `sections`: one file for each section
//! - `page`, `html`, `drawings`, `page.css`: sections and blocks; the page; its charts; its style
//! - `diagram`, `picture`, `numbers`: the wiring as a drawing; PNG files; numbers as text

mod again;
#[cfg(test)]
mod broken;
mod command;
mod diagram;
mod drawings;
mod html;
mod motion;
pub mod numbers;
mod overlay;
mod page;
mod picture;
mod ramp;
mod ranking;
mod recording;
mod rows;
mod sections;
mod source;
mod statistics;
mod thinned;
mod views;
pub mod wiring;

pub use command::Report;
