//! `stillpoint report`: a session as one page that needs nothing else, or as JSON.
//!
//! A session is read once ([`recording`]), each section makes figures of it and then blocks ([`page`]) of the figures,
//! and the blocks become HTML. A new section is a file in [`sections`] and a line in its list.
//!
//! - `command`: the subcommand
//! - `recording`, `wiring`, `thinned`: what is read of a session; who feeds whom; long rows in bounded memory
//! - `motion`, `statistics`: estimates against the truth; plain numbers
//! - `ramp`: what the gains of a filter do to noise and to a ramp
//! - `views`, `overlay`: images with what was found in them; the same as pictures
//! - `sections`: one file for each section
//! - `page`, `html`, `page.css`: sections and blocks; the page; its style
//! - `diagram`, `picture`, `numbers`: the wiring as a drawing; PNG files; numbers as text

mod command;
mod diagram;
mod html;
mod motion;
mod numbers;
mod overlay;
mod page;
mod picture;
mod ramp;
mod recording;
mod sections;
mod source;
mod statistics;
mod thinned;
mod views;
mod wiring;

pub use command::Report;
