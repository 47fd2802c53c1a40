//! Recordings of force from files.
