//! Controllers: targets, a baseline, linear-quadratic and adaptive neural control.

#![forbid(unsafe_code)]
