//! From YAML to a checked graph.
