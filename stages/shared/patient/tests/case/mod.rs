//! Cases: their file, and what they are read from.

mod case_file;
mod described;
mod planning_data;
mod small;
