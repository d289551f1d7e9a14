//! Whole systems: real processes, real shared memory, real recordings.
