//! The mechanics of air bladders and of a head that rests on them: plain mathematics, no pipeline.

#![forbid(unsafe_code)]
