//! Cases: their file, and what they are read from.

mod case_file;
mod described;
mod intake;
mod planning_data;
mod small;
