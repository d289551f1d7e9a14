//! - `vectors`: `d_pem`, and the reference fit of a recorded sequence
//! - `simulated`: systems that are known
//! - `file`: the model as a file

mod file;
mod simulated;
mod vectors;
