//! Counts to strain to force, and how the finger's matrix is found.
